"""Requirements of formats on a dataset; errors name the scenario or agent without the data."""

from collections.abc import Callable

from advercity_dsl import Agent

from advercity.dataset.formats import OPV2V
from advercity.dataset.reader import Dataset
from advercity.errors import InputError


def require_truth(dataset: Dataset, format: str) -> None:
    """Check whether a dataset has truth about objects besides their boxes.

    Raises:
        InputError: A scenario has the original's layout.
    """
    for scenario in dataset.scenarios:
        if scenario.format != OPV2V:
            raise InputError(
                f"{scenario.path}: has the layout {scenario.format.name}, without boxes in images"
                f"; {format} is exported from {OPV2V.name}"
            )


def require_pinholes(
    dataset: Dataset,
    format: str,
    select: Callable[[Agent], range] = lambda agent: range(len(agent.sensors.cameras)),
) -> None:
    """Check that no camera has a lens, for formats without lens models.

    Args:
        dataset: The dataset.
        format: Name of the format.
        select: Selects the exported cameras of an agent, by their numbers.

    Raises:
        InputError: One has a lens.
    """
    for scenario in dataset.scenarios:
        for agent in scenario.spec.recorded_agents:
            for number in select(agent):
                if agent.sensors.cameras[number].model.lens is not None:
                    raise InputError(
                        f"{scenario.path}: camera{number} of {agent.id} has a lens, whose"
                        f" distortion {format} cannot describe; export a dataset of a rig with"
                        " pinhole cameras"
                    )
