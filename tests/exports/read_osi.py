"""Reads traces of the Open Simulation Interface with betterosi."""

import json
import sys
from typing import Any

import betterosi  # pyright: ignore[reportMissingImports]


def summarize(truth: Any) -> dict[str, Any]:
    """Summarise a GroundTruth."""
    version = truth.version
    weather = truth.environmental_conditions
    return {
        "version": [version.version_major, version.version_minor, version.version_patch],
        "time_s": truth.timestamp.seconds + truth.timestamp.nanos / 1e9,
        "host": truth.host_vehicle_id.value,
        "fog": weather.fog.name,
        "precipitation": weather.precipitation.name,
        "wind": [weather.wind.origin_direction, weather.wind.speed],
        "objects": {
            str(item.id.value): {
                "type": item.type.name,
                "place": [getattr(item.base.position, axis) for axis in "xyz"],
                "velocity": [getattr(item.base.velocity, axis) for axis in "xyz"],
                "acceleration": [getattr(item.base.acceleration, axis) for axis in "xyz"],
                "angles": [getattr(item.base.orientation, a) for a in ("roll", "pitch", "yaw")],
                "size": [
                    getattr(item.base.dimension, side) for side in ("length", "width", "height")
                ],
                "brakes": item.vehicle_classification.light_state.brake_light_state.name
                if item.vehicle_classification
                else None,
            }
            for item in truth.moving_object
        },
        "lights": [
            [light.classification.color.name, light.classification.mode.name]
            for light in truth.traffic_light
        ],
    }


truths, views = sys.argv[1:]
print(
    json.dumps(
        {
            "truths": [summarize(one) for one in betterosi.read(truths, return_ground_truth=True)],
            "views": [
                [one.host_vehicle_id.value, summarize(one.global_ground_truth)]
                for one in betterosi.read(views, return_sensor_view=True)
            ],
        }
    )
)
