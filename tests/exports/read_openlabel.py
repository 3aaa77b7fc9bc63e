"""Loads OpenLABEL files with VCD, which validates them by the JSON Schema of the standard."""

import json
import sys

from vcd import core  # pyright: ignore[reportMissingImports]

label = core.OpenLABEL()
label.load_from_file(sys.argv[1], validation=True)
cars = label.get_elements_of_type(core.ElementType.object, "car")
print(
    json.dumps(
        {
            "version": label.get_metadata()["schema_version"],
            "frames": label.get_frame_intervals().get(),
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
