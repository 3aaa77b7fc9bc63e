"""Formats authors and licences of third-party models and photographs in a scenario."""

from advercity_dsl import Spec
from advercity_dsl.catalogue import FreeLicence

from advercity.assets.model_conversion import format_model_name
from advercity.dataset.manifest import Identity
from advercity.texture_packs import TEXTURE_PACKS

LICENCE_URLS = {
    "CC0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "CC-BY-3.0": "https://creativecommons.org/licenses/by/3.0/",
    "CC-BY-3.0-US": "https://creativecommons.org/licenses/by/3.0/us/",
    "CC-BY-4.0": "https://creativecommons.org/licenses/by/4.0/",
    "CC-BY-SA-4.0": "https://creativecommons.org/licenses/by-sa/4.0/",
    "MIT": "https://opensource.org/license/mit",
}
ATTRIBUTION_HEADER = """# Attribution
"""
MODELS_HEADER = """
Pictures and point clouds of this scenario show 3-D models of others. They were scaled to the size
of their blueprints, thinned, and given materials of this project; what their authors made is used
under these licences:

| blueprint | model | author | licence |
|---|---|---|---|
"""
PHOTOGRAPHS_HEADER = """
Pictures of this scenario show photographs of surfaces by others, brought to the mean colour of the
materials of this project, under these licences:

| surface | photograph | author | licence |
|---|---|---|---|
"""


def format_attribution(spec: Spec, identity: Identity) -> str:
    """Format the authors and licences of third-party content as Markdown; "" without any."""
    models = [
        f"| {name} | {format_model_name(model)} | {model.author} |"
        f" {_link_licence(model.licence)} |\n"
        for name in sorted(identity.bodies)
        if (model := spec.blueprints[name].model) is not None
    ]
    photographs = [
        f"| {name} | {pack.package} {surface.color.path} | {pack.author} |"
        f" {_link_licence(pack.licence)} |\n"
        for asset, pack in TEXTURE_PACKS.items()
        if asset in spec.assets and asset not in identity.missing_models
        for name, surface in pack.surfaces.items()
    ]
    tables = ((MODELS_HEADER, models), (PHOTOGRAPHS_HEADER, photographs))
    text = "".join(header + "".join(rows) for header, rows in tables if rows)
    return ATTRIBUTION_HEADER + text if text else ""


def _link_licence(licence: FreeLicence) -> str:
    return f"[{licence}]({LICENCE_URLS[licence]})"
