"""Loads OpenLABEL files with VCD, which validates them by the JSON Schema of the standard.

Kognic's model, which its annotation tool reads, is stricter in some places.
"""

import json
import sys
from pathlib import Path

from kognic.openlabel.models import OpenLabelAnnotation  # pyright: ignore[reportMissingImports]
from vcd import core  # pyright: ignore[reportMissingImports]

label = core.OpenLABEL()
label.load_from_file(sys.argv[1], validation=True)
strict = OpenLabelAnnotation.model_validate_json(Path(sys.argv[1]).read_text())
cars = label.get_elements_of_type(core.ElementType.object, "car")
print(
    json.dumps(
        {
            "version": label.get_metadata()["schema_version"],
            "frames": label.get_frame_intervals().get(),
            "timestamp": strict.openlabel.frames[sys.argv[2]].frame_properties.timestamp,
            "objects": sorted(label.get_objects()),
            "cars": sorted(cars),
            "streams": {name: item["type"] for name, item in label.get_streams().items()},
            "systems": sorted(label.get_coordinate_systems()),
            "boxes": {
                uid: label.get_object_data(uid, "box", frame_num=int(sys.argv[2]))["val"]
                for uid in label.get_objects()
            },
        }
    )
)
