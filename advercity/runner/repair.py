"""Makes damaged files of a dataset again, from the spec that its manifest holds."""

from pathlib import Path

from pydantic import TypeAdapter

from advercity.dataset.manifest import Identity, Manifest, scenarios
from advercity.dataset.reading import Reading
from advercity.dataset.restoring import restore
from advercity.dataset.verification import Problem, unlike_the_index, verify
from advercity.errors import RunError
from advercity.rendering.backend import Profile
from advercity.rendering.registry import load_backend
from advercity.runner.preparation import identity_of
from advercity.runner.progress import Progress, Report, no_report
from advercity.runner.sensing import senses
from advercity.runner.stage import set_stage
from advercity.runner.viewpoints import Viewpoints


def repair(dataset: Path, report: Report = no_report) -> list[Problem]:
    """Make every missing or changed file of a dataset again; the problems that stay.

    A scenario that is gone, or whose manifest is another one, is for `run` to make again.

    Raises:
        InputError: There is no dataset.
        RunError: The files cannot be made again here, or the disk does not take them.
    """
    left = unlike_the_index(dataset)
    for scenario in scenarios(dataset):
        problems = verify(scenario)
        if problems:
            left += _repair(scenario, problems, report)
    return left


def _repair(scenario: Path, problems: list[Problem], report: Report) -> list[Problem]:
    if all(problem.frame is None for problem in problems):
        return restore(scenario, problems, lambda frame: ())
    manifest = Manifest.load(scenario)
    spec, renderer = manifest.spec, manifest.identity.renderer
    backend = load_backend(str(renderer["backend"]))
    profile = _profile(manifest.identity)
    report(Progress(spec.id, "traffic"))
    stage = set_stage(spec)
    here = identity_of(spec, stage, backend, profile, format=manifest.identity.format)
    differences = manifest.identity.differences(here)
    if differences:
        raise RunError(
            f"{scenario}: cannot be repaired here, where something is not as it was"
            f" ({'; '.join(differences)}); repair it with what it was made with, or make it anew"
            " with `advercity run --fresh`"
        )
    viewpoints = Viewpoints(spec, stage.trace)
    damaged = sorted({problem.frame for problem in problems if problem.frame is not None})
    with senses(viewpoints, stage, backend, profile) as sensed:

        def readings_of(frame: int) -> tuple[Reading, ...]:
            report(Progress(spec.id, "frames", damaged.index(frame), len(damaged)))
            return sensed.read(frame)

        left = restore(scenario, problems, readings_of)
    report(Progress(spec.id, "done", len(damaged), len(damaged)))
    return left


def _profile(identity: Identity) -> Profile:
    """The profile that a manifest tells of."""
    kept = identity.renderer.keys() - {"backend", "backend_sha256", "device"}
    values = {name: identity.renderer[name] for name in kept}
    return TypeAdapter(Profile).validate_python({"name": "as made", **values})
