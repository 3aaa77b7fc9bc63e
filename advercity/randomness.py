"""Random numbers keyed by what they are for, never by the order in which they are asked for."""

import hashlib

import numpy as np


def generator(*key: int | str) -> np.random.Generator:
    """A Philox generator that is a pure function of `key`.

    Example: `generator(spec.seeds.sensors, "lidar", agent_id, frame)`. Two keys that differ
    anywhere give independent streams (the key is hashed to Philox's 128 bits).
    """
    text = "\x1f".join(f"{type(part).__name__}:{part}" for part in key)
    digest = hashlib.blake2b(text.encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))
