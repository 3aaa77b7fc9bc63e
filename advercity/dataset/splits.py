"""Splits of a dataset: folders of links to scenarios, which loaders take as their root."""

import hashlib
import json
import os
from collections import defaultdict
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from advercity_dsl import Spec
from pydantic import TypeAdapter, ValidationError

from advercity.atomic_files import resolve_links
from advercity.dataset.manifest import Manifest
from advercity.dataset.scenario_folders import (
    SPLITS_FILE,
    check_is_outside_datasets,
    check_is_outside_exports,
    find_scenarios_by_name,
)
from advercity.documents import MAX_JSON_BYTES, parse_json, read_bytes
from advercity.errors import InputError, RunError, describe_cause
from advercity.output_files import check_link, check_output, make_links, write_output

PUBLISHED_SPLITS = {"train": ("ri", "rsnj", "unj"), "validate": ("rcnj",), "test": ("ui",)}
"""Roads by split, as Adver-City was published."""
SPLIT_KEYS: Mapping[str, Callable[[Spec], str]] = {
    "road": lambda spec: spec.road.id,
    "scene": lambda spec: f"{spec.road.id}/{spec.seeds.traffic}",
    "seed": lambda spec: str(spec.seeds.traffic),
    "density": lambda spec: spec.density.id,
    "weather": lambda spec: spec.weather.id,
    "time": lambda spec: spec.weather.time,
}
"""Property of a scenario by which a dataset is split; scenarios of a scene have one traffic."""
_SPLITS = TypeAdapter(dict[str, list[str]])


def link_splits(
    dataset: Path,
    output: Path,
    values: Mapping[str, Collection[str]] = PUBLISHED_SPLITS,
    *,
    by: str = "road",
) -> dict[str, list[str]]:
    """Link every scenario into `output/<split>/`, and write an index; return scenarios by split.

    Links are not copies. Calling it again updates them.

    Args:
        dataset: Folder of the dataset.
        output: Folder for the splits.
        values: Values of the property, such as roads, by split.
        by: Property of `SPLIT_KEYS`.

    Raises:
        InputError: Two scenarios have one name, a value belongs to no split, or to two, or is
            neither the dataset's nor a published road, or `output` is in a dataset or an export, or
            has a `splits.json`, link or file from elsewhere; no link is changed then.
        RunError: The links cannot be made.
    """
    split_of = _map_values_to_splits(values, by)
    folders, value_of = _read_values(dataset, output, by)
    _check_values_are_known(values, {*value_of.values()}, dataset, by)
    for name, value in value_of.items():
        if value not in split_of:
            message = f"{folders[name]}: {by} '{value}' is in no split; name it in one"
            raise InputError(message)
    return _link(
        folders, {name: split_of[value] for name, value in value_of.items()}, values, output
    )


def link_shares(
    dataset: Path, output: Path, shares: Mapping[str, float], *, by: str = "scene"
) -> dict[str, list[str]]:
    """Draw splits of given shares; scenarios with a property in common stay together.

    The draw is the same for the same scenarios. Every split with a share gets a group.

    Args:
        dataset: Folder of the dataset.
        output: Folder for the splits.
        shares: Positive share of each split; they are divided by their sum.
        by: Property of `SPLIT_KEYS`.

    Raises:
        InputError: As by `link_splits`, or there are fewer groups than splits.
        RunError: The links cannot be made.
    """
    folders, value_of = _read_values(dataset, output, by)
    groups = defaultdict[str, list[str]](list)
    for name, value in value_of.items():
        groups[value].append(name)
    wanted = {split: share for split, share in shares.items() if share > 0}
    if len(groups) < len(wanted):
        known = ", ".join(sorted(groups))
        raise InputError(
            f"{dataset}: {len(wanted)} splits need as many values of {by}; it has {known}"
        )
    scale = len(folders) / sum(wanted.values())
    missing = {split: share * scale for split, share in wanted.items()}
    split_of: dict[str, str] = {}
    # Largest groups first; the last ones fill the gaps. Equal ones are in a fixed random order.
    order = sorted(groups, key=lambda value: (-len(groups[value]), _draw_order(value)))
    for number, value in enumerate(order):
        empty = wanted.keys() - split_of.values()
        # The last groups are for splits still empty.
        takers = empty if len(empty) == len(order) - number else wanted
        split = max((it for it in wanted if it in takers), key=lambda split: missing[split])
        missing[split] -= len(groups[value])
        split_of |= dict.fromkeys(groups[value], split)
    return _link(folders, split_of, shares, output)


def _draw_order(value: str) -> bytes:
    return hashlib.blake2b(value.encode(), digest_size=8).digest()


def _read_values(dataset: Path, output: Path, by: str) -> tuple[dict[str, Path], dict[str, str]]:
    folders = find_scenarios_by_name(dataset)
    check_is_outside_datasets(output)
    check_is_outside_exports(output)
    read_value = SPLIT_KEYS[by]
    return folders, {name: read_value(Manifest.load(it).spec) for name, it in folders.items()}


def _link(
    folders: dict[str, Path], split_of: Mapping[str, str], splits: Collection[str], output: Path
) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {name: [] for name in splits}
    for name in folders:
        found[split_of[name]].append(name)
    try:
        _link_folders(folders, found, output)
    except OSError as error:
        where = error.filename2 or error.filename or output  # of a link, the second is its place
        raise RunError(f"{where}: cannot be written: {describe_cause(error)}") from error
    return found


def _map_values_to_splits(values: Mapping[str, Collection[str]], by: str) -> dict[str, str]:
    names = [value for chosen in values.values() for value in chosen]
    twice = sorted({value for value in names if names.count(value) > 1})
    if twice:
        raise InputError(f"{by} '{twice[0]}' is named twice; leave it in one split, once")
    return {value: name for name, chosen in values.items() for value in chosen}


def _check_values_are_known(
    values: Mapping[str, Collection[str]], known: Collection[str], dataset: Path, by: str
) -> None:
    """Refuse values of no scenario; published roads may be missing in a partial dataset."""
    published = {road for group in PUBLISHED_SPLITS.values() for road in group}
    for split, chosen in values.items():
        for value in chosen:
            if value not in known and not (by == "road" and value in published):
                raise InputError(
                    f"{split}: no scenario of {dataset} has the {by} '{value}';"
                    f" it has {', '.join(sorted(known))}"
                )


def _link_folders(folders: dict[str, Path], found: dict[str, list[str]], output: Path) -> None:
    path, content = output / SPLITS_FILE, json.dumps(found, indent=1).encode() + b"\n"
    check_output(path, hashlib.sha256(content).hexdigest())
    links = {
        # Relative: dataset and splits can be moved together.
        output / split / name: os.path.relpath(
            resolve_links(folders[name]), resolve_links(output / split)
        )
        for split, names in found.items()
        for name in names
    }
    former = _load_splits(path)
    stale = {output / split / name for split, names in former.items() for name in names} - {*links}
    for link in (*links, *stale):
        check_link(link, links.get(link))
    with _create_folders([output / split for split in found]):
        for link in stale:
            link.unlink(missing_ok=True)
        make_links(links)
        write_output(path, content)


@contextmanager
def _create_folders(folders: Sequence[Path]) -> Generator[None]:
    """Create folders; after an error, remove the new, empty ones."""
    wanted = dict.fromkeys(path for folder in folders for path in (folder, *folder.parents))
    missing = sorted((path for path in wanted if not os.path.lexists(path)), reverse=True)
    try:
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError:
        for path in missing:
            with suppress(OSError):
                path.rmdir()
        raise


def _load_splits(path: Path) -> dict[str, list[str]]:
    """Load the scenarios of the latest links, by split; empty if there are none."""
    with suppress(OSError, InputError, ValidationError):
        return _SPLITS.validate_python(parse_json(read_bytes(path, max_bytes=MAX_JSON_BYTES), path))
    return {}
