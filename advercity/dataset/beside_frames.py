"""Files of a scenario that belong to no frame: its protocol, and whose models it shows."""

from advercity_dsl import Spec

from advercity.dataset.formats import PROTOCOL, protocol
from advercity.dataset.manifest import Identity

ATTRIBUTION = "ATTRIBUTION.md"
LICENCE_TEXTS = {
    "CC0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "CC-BY-3.0": "https://creativecommons.org/licenses/by/3.0/",
    "CC-BY-3.0-US": "https://creativecommons.org/licenses/by/3.0/us/",
    "CC-BY-4.0": "https://creativecommons.org/licenses/by/4.0/",
    "CC-BY-SA-4.0": "https://creativecommons.org/licenses/by-sa/4.0/",
    "MIT": "https://opensource.org/license/mit",
}
HEAD = """# Attribution

Pictures and point clouds of this scenario show 3-D models of others. They were scaled to the size
of their blueprints, thinned, and given materials of this project; what their authors made is used
under these licences:

| blueprint | model | author | licence |
|---|---|---|---|
"""


def beside_frames(spec: Spec, identity: Identity) -> dict[str, bytes]:
    """Content of every such file by its path; models are attributed where any were used."""
    files = {PROTOCOL: protocol(spec)}
    if identity.bodies:
        files[ATTRIBUTION] = attribution(spec, identity).encode()
    return files


def attribution(spec: Spec, identity: Identity) -> str:
    """Who made the models that the scenario shows, and on what terms they are used."""
    rows = [
        f"| {name} | {model.pack or model.file} | {model.author} |"
        f" [{model.licence}]({LICENCE_TEXTS[model.licence]}) |\n"
        for name in sorted(identity.bodies)
        if (model := spec.blueprints[name].model) is not None
    ]
    return HEAD + "".join(rows)
