"""Checks documents against the schemas of ASAM, which its checker bundles have."""

import json
import sys
from importlib.resources import files
from pathlib import Path

import xmlschema  # pyright: ignore[reportMissingImports]


def find_schema(package: str, path: str) -> str:
    return str(files(package) / "schema" / path)


schemas = {
    ".xosc": lambda: xmlschema.XMLSchema(find_schema("qc_openscenario", "1.2.0/OpenSCENARIO.xsd")),
    ".xodr": lambda: xmlschema.XMLSchema11(
        find_schema("qc_opendrive", "1.7.0/opendrive_17_core.xsd")
    ),
}
found = {}
for name in sys.argv[1:]:
    schema = schemas[Path(name).suffix]()
    found[Path(name).name] = [str(error.reason) for error in schema.iter_errors(name)]
print(json.dumps(found))
