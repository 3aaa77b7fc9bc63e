"""The formats for exports of datasets, by name.

A distribution registers its `ExportFormat`, under the format's name, as an entry point of the group
`advercity.exports`. The usual formats are in the distribution advercity-exports.
"""

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache

from advercity_dsl.registry import Registered, load_named, load_registered
from advercity_dsl.sensor_kinds import load_sensor_kinds

from advercity.dataset.manifest import CODE_PACKAGES
from advercity.dataset.reader import Dataset
from advercity.digests import compute_source_digest
from advercity.errors import InputError
from advercity.exports.pieces import Piece

Options = Mapping[str, str]
"""Values of all options of a format, by name."""
PieceLister = Callable[[Dataset, Options], list[Piece]]
"""Splits a dataset into pieces; InputError if it lacks data for the format."""
Quantifier = Callable[[Iterable[object]], bool]
"""`all` or `any`."""


@dataclass(frozen=True)
class ExportFormat:
    """A format.

    Attributes:
        name: Its name on the command line.
        lister: Names, as `module:attribute`, the function that splits a dataset into pieces. It is
            loaded when the format is used, with the libraries it needs.
        options: Possible values of its options by name; the first is taken unless another is named.
        needs: Kinds of sensors that it needs of `all` agents of a scenario, or of `any` of them.
    """

    name: str
    lister: str
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    needs: Mapping[str, Quantifier] = field(default_factory=dict[str, Quantifier])

    def load(self) -> PieceLister:
        """Load the function for splitting a dataset into pieces."""
        lister: PieceLister = load_named(self.lister)
        return lister

    def compute_code_digest(self) -> str:
        """Compute the SHA-256 of the sources that write the format."""
        package = self.lister.partition(":")[0].partition(".")[0]
        return compute_source_digest(*CODE_PACKAGES, package)

    def check_sensors(self, dataset: Dataset) -> None:
        """Raise an InputError if a scenario has not the sensors it needs."""
        for scenario in dataset.scenarios:
            agents = scenario.spec.recorded_agents
            for kind, of_agents in self.needs.items():
                lacking = [one.id for one in agents if not one.sensors.list_sensors(kind)]
                if of_agents(one.id not in lacking for one in agents):
                    continue
                who, wanted = (
                    (f"{lacking[0]} has no", "every agent")
                    if of_agents is all
                    else ("no agent has a", "one agent")
                )
                title = load_sensor_kinds().found[kind].title
                raise InputError(
                    f"{scenario.path}: {who} {title}, as {self.name} needs of {wanted}"
                )

    def complete_options(self, given: Mapping[str, str | None]) -> dict[str, str]:
        """Complete options by their defaults, also in place of None.

        Raises:
            InputError: The format has no such option, or it has no such value.
        """
        chosen = {name: values[0] for name, values in self.options.items()}
        for name, value in given.items():
            if value is None:
                continue
            if name not in self.options:
                raise InputError(f"`{name}` {value}: {self.name} has no such option")
            if value not in self.options[name]:
                raise InputError(f"`{name}` {value}: {' or '.join(self.options[name])}")
            chosen[name] = value
        return chosen


@cache
def load_export_formats() -> Registered[ExportFormat]:
    """Load the formats of this installation."""
    return load_registered("advercity.exports", {}, ExportFormat)


def find_export_format(name: str) -> ExportFormat:
    """Return the format of that name; InputError with the nearest names if there is none."""
    formats = load_export_formats()
    if name in formats.found:
        return formats.found[name]
    if name in formats.broken:
        raise InputError(f"{name}: this format cannot be used: {formats.broken[name]}")
    if not formats.found:
        raise InputError(
            "no format to export to is installed; try: pip install 'advercity[export]'"
        )
    close = difflib.get_close_matches(name.lower(), formats.found, n=2, cutoff=0.5)
    hint = f"did you mean {' or '.join(close)}?" if close else f"{', '.join(formats.found)}"
    raise InputError(f"{name}: no such format to export to; {hint}")
