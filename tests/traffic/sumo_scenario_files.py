"""A SUMO scenario as others publish it, with files that it would write."""

import gzip
from pathlib import Path

from tests.roads.sumo_networks import build_crossing_network

SPEED_M_S, LENGTH_M, DEPART_M = 8.0, 5.0, 20.0
"""Of the car that drives north without meeting anybody."""
PHASES = ((4, "G"), (3, "y"), (6, "r"))
"""Seconds and state of all links of the light, by the program of the additional file."""
ROUTES = f"""<routes>
  <vType id="plain" length="{LENGTH_M}" maxSpeed="{SPEED_M_S}" sigma="0" speedDev="0"
    vClass="passenger" emissionClass="PHEMlight/PC_G_EU4" jmDriveAfterRedTime="1000"
    imgFile="car.png">
    <param key="has.ssm.device" value="true"/><param key="device.ssm.file" value="ssm.xml"/>
  </vType>
  <vType id="coach" vClass="bus"/><vType id="train" vClass="tram"/>
  <route id="north" edges="in_south out_north"/>
  <vehicle id="north/1" type="plain" route="north" depart="0" departPos="{DEPART_M}"
    departSpeed="max" departLane="2"/>
  <person id="walker" depart="0"><walk edges="in_west out_south"/></person>
  <vehicle id="line#7" type="coach" depart="1"><route edges="in_east out_west"/></vehicle>
</routes>"""
ADDITIONAL = """<additional>
  <tlLogic id="mid" type="static" programID="own" offset="0">{phases}</tlLogic>
  <inductionLoop id="loop" lane="in_south_1" pos="5" period="1" file="loop.xml"/>
  <edgeData id="all" file="edges.xml"/>
  <calibrator id="c" edge="in_north" pos="0" output="calibrator.xml"/>
</additional>"""
CONFIGURATION = """<configuration>
  <input><net-file value="town.net.xml.gz"/><route-files value="town.rou.xml"/>
    <additional-files value="town.add.xml"/></input>
  <output><fcd-output value="fcd.xml"/><tripinfo-output value="trips.xml"/></output>
  <time><begin value="0"/><end value="0:01:00"/><step-length value="0.1"/></time>
  <report><log value="log.txt"/></report>
  <new_section><novelty value="1"/></new_section>
</configuration>"""


def write_sumo_scenario(
    folder: Path, *, configuration: str = CONFIGURATION, routes: str = ROUTES
) -> Path:
    """Write the files and return the configuration."""
    folder.mkdir(parents=True, exist_ok=True)
    network = build_crossing_network()
    links = network.count('tl="mid"')
    phases = (f'<phase duration="{time_s}" state="{state * links}"/>' for time_s, state in PHASES)
    (folder / "town.net.xml.gz").write_bytes(gzip.compress(network.encode()))
    (folder / "town.rou.xml").write_text(routes, encoding="utf-8")
    additional = ADDITIONAL.format(phases="".join(phases))
    (folder / "town.add.xml").write_text(additional, encoding="utf-8")
    path = folder / "town.sumocfg"
    path.write_text(configuration, encoding="utf-8")
    return path
