"""Names by which declarations refer to others: a library's unknown names, found all at once."""

from collections.abc import Callable, Iterable, Iterator

from advercity_dsl import Catalogue, Conflict, Suite, Weather
from advercity_dsl.base import suggest_name

from advercity.compiler.library import Library
from advercity.compiler.scenarios import expand_sweeps, parse_conditions
from advercity.diagnostics import Diagnostic, DiagnosticsError

SUITE_REFERENCES = {
    "roads": "road",
    "weathers": "weather",
    "densities": "density",
    "cross_conflicts": "conflict",
    "rig": "rig",
    "channel": "channel",
    "catalogue": "catalogue",
    "drivers": "drivers",
    "reaction_weather": "weather",
}
"""Fields of a suite with names of declarations, and their kinds."""
SELECTIONS = ("roads", "weathers", "densities", "cross_conflicts")
"""Fields of a suite with `all` as an option; in the others it is an id."""


def check_references(library: Library, suites: Iterable[Suite]) -> None:
    """Check every name in suites and in the library's conflicts and catalogues.

    Raises:
        DiagnosticsError: With all unknown names, also of fields.
    """
    found = [*_check_crash_types(library), *_check_blueprints(library), *_check_suns(library)]
    for suite in suites:
        found += _check_suite(library, suite)
    if found:
        raise DiagnosticsError(*found)


def _check_suite(library: Library, suite: Suite) -> Iterator[Diagnostic]:
    for field, kind in SUITE_REFERENCES.items():
        written: str | tuple[str, ...] | None = getattr(suite, field)
        if isinstance(written, tuple):
            for index, name in enumerate(written):
                yield from library.check_reference(suite, field, index, kind=kind, name=name)
        elif written is not None and not (written == "all" and field in SELECTIONS):
            yield from library.check_reference(suite, field, kind=kind, name=written)
    for agent, rig in suite.agents.items():
        yield from library.check_reference(suite, "agents", agent, kind="rig", name=rig)
    yield from _check_bodies(library, suite)
    for road, conflicts in suite.stage.items():
        yield from library.check_reference(suite, "stage", road, kind="road", name=road)
        for index, name in enumerate(conflicts):
            at = ("stage", road, index)
            yield from library.check_reference(suite, *at, kind="conflict", name=name)
    source = library.find_entry(suite).source
    yield from _collect(lambda: parse_conditions(suite, source))
    yield from _collect(lambda: expand_sweeps(suite, source))


def _check_bodies(library: Library, suite: Suite) -> Iterator[Diagnostic]:
    catalogue = library.get_declarations(Catalogue).get(suite.catalogue)
    if catalogue is None:
        return
    for agent, name in suite.bodies.items():
        if name not in catalogue.blueprints:
            hint = suggest_name(name, catalogue.blueprints)
            message = f"unknown blueprint '{name}'"
            yield library.build_diagnostic(suite, "bodies", agent, message=message, hint=hint)


def _collect(check: Callable[[], object]) -> tuple[Diagnostic, ...]:
    try:
        check()
    except DiagnosticsError as error:
        return error.diagnostics
    return ()


def _check_crash_types(library: Library) -> Iterator[Diagnostic]:
    known = library.crash_types
    for conflict in library.get_declarations(Conflict).values():
        for index, name in enumerate(conflict.stages):
            if name not in known:
                message, hint = f"unknown crash type '{name}'", suggest_name(name, known)
                at = ("stages", index)
                yield library.build_diagnostic(conflict, *at, message=message, hint=hint)


def _check_suns(library: Library) -> Iterator[Diagnostic]:
    for weather in library.get_declarations(Weather).values():
        document = library.find_entry(weather).source.document
        for name in weather.sun_at:
            # The parent of a weather may name roads of its own library.
            if document.has_value(("sun_at", name)):
                yield from library.check_reference(weather, "sun_at", name, kind="road", name=name)


def _check_blueprints(library: Library) -> Iterator[Diagnostic]:
    for catalogue in library.get_declarations(Catalogue).values():
        if catalogue.ego not in catalogue.blueprints:
            message = f"unknown blueprint '{catalogue.ego}'"
            hint = suggest_name(catalogue.ego, catalogue.blueprints)
            yield library.build_diagnostic(catalogue, "ego", message=message, hint=hint)
