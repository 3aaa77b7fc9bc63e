"""The compiler: from YAML declarations to specs.

A declaration is read with positions (`source`), merged with its parents (`extends`), validated
(`validation`) and indexed in a library (`library`). A suite is resolved (`suites`), crossed into
the inputs of scenarios (`crossing`, `scenarios`), and assembled into specs (`assembly`), JSON files
(`spec_files`).
"""

from advercity.compiler.assembly import is_edited, with_digest, with_weather
from advercity.compiler.crossing import (
    check_not_edited,
    compile_library,
    compile_suite,
    find_suite,
    validate_paths,
)
from advercity.compiler.explain import compare_specs, explain_spec
from advercity.compiler.library import (
    Library,
    LibraryEntry,
    find_declaration_file,
    find_weather,
    list_weathers,
    load_declaration,
    load_library,
)
from advercity.compiler.shipped_library import find_shipped_library
from advercity.compiler.spec_files import describe_spec_differences, read_spec, to_json, write_specs
from advercity.diagnostics import Diagnostic, DiagnosticsError

__all__ = [
    "Diagnostic",
    "DiagnosticsError",
    "Library",
    "LibraryEntry",
    "check_not_edited",
    "compare_specs",
    "compile_library",
    "compile_suite",
    "describe_spec_differences",
    "explain_spec",
    "find_declaration_file",
    "find_shipped_library",
    "find_suite",
    "find_weather",
    "is_edited",
    "list_weathers",
    "load_declaration",
    "load_library",
    "read_spec",
    "to_json",
    "validate_paths",
    "with_digest",
    "with_weather",
    "write_specs",
]
