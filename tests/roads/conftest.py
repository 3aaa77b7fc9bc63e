"""Imported and authored roads that several modules test."""

from pathlib import Path
from typing import Any

import pytest
import sumolib
import yaml
from advercity_dsl import Road, Spec, Vehicle

from advercity.roads.layout import RoadLayout, lay_out_road
from advercity.roads.sumo_network import write_sumo_network
from tests.roads.imported_roads import BEND, CROSSROADS, compiled, declaration

NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")


@pytest.fixture(scope="session")
def bend(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Spec:
    return compiled(library, tmp_path_factory.mktemp("bend"), BEND)


@pytest.fixture(scope="session")
def crossroads(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Spec:
    return compiled(library, tmp_path_factory.mktemp("crossroads"), CROSSROADS)


@pytest.fixture(scope="session")
def authored(specs: dict[str, Spec]) -> Spec:
    return specs["ui_clear_day_sparse"]


@pytest.fixture(scope="session")
def reimported(library: Path, authored: Spec, tmp_path_factory: pytest.TempPathFactory) -> Spec:
    """The urban intersection, from the SUMO network that was built of its declaration."""
    folder = tmp_path_factory.mktemp("reimported")
    write_sumo_network(authored.road, folder).rename(folder / "ui.net.xml")
    agents = {
        name: agent.model_copy(update={"route": ()}) if isinstance(agent, Vehicle) else agent
        for name, agent in authored.road.agents.items()
    }
    dumped = {name: agent.model_dump(mode="json") for name, agent in agents.items()}
    return compiled(library, folder, declaration("sumo", "ui.net.xml", agents=dumped))


@pytest.fixture(scope="session")
def roads(library: Path) -> dict[str, Road]:
    """Every shipped road, as declared."""
    paths = {name: library / f"nhtsa/roads/{name}.yaml" for name in NAMES}
    return {
        name: Road.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
        for name, path in paths.items()
    }


@pytest.fixture(scope="session")
def files(roads: dict[str, Road], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The SUMO network of every shipped road."""
    return {
        name: write_sumo_network(road, tmp_path_factory.mktemp(name))
        for name, road in roads.items()
    }


@pytest.fixture(scope="session")
def networks(files: dict[str, Path]) -> dict[str, Any]:
    """The same networks, read by `sumolib`."""
    return {
        name: sumolib.net.readNet(str(path), withInternal=True, withPrograms=True)
        for name, path in files.items()
    }


@pytest.fixture(scope="session")
def layouts(roads: dict[str, Road]) -> dict[str, RoadLayout]:
    """Every shipped road, laid out."""
    return {name: lay_out_road(road) for name, road in roads.items()}
