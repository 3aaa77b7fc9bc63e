from tests.builders import SMALL_LIBRARY, Write, describe_errors


def test_a_misspelt_key_is_reported_with_position_and_the_most_similar_name(write: Write) -> None:
    folder = write(weather="kind: weather\nid: fog_day\ntime: day\nfog:\n  mor: 75\n")
    assert describe_errors(folder) == (
        "weather.yaml:5:3: fog.mor: no such field; did you mean 'mor_m'?"
    )


def test_an_invalid_unit_is_reported_with_the_valid_ones(write: Write) -> None:
    folder = write(weather="kind: weather\nid: fog_day\ntime: day\nfog: {mor_m: 75 deg}\n")
    assert describe_errors(folder) == (
        "weather.yaml:4:14: fog.mor_m: 'deg' is a unit of angle; units of length: um, mm, cm, m,"
        " km, in, ft, mi"
    )


def test_a_scenario_records_at_least_three_frames(write: Write) -> None:
    suite = (
        SMALL_LIBRARY / "suite.yaml"
    ).read_text() + "timing: {warm_up_ticks: 59, max_ticks: 60}\n"
    assert "leaves fewer than three frames" in describe_errors(write(suite=suite))


def test_a_list_whose_only_item_is_invalid_is_not_said_to_be_too_short_as_well(
    write: Write,
) -> None:
    rig = (SMALL_LIBRARY / "rig.yaml").read_text().replace("{x_m: 1, z_m: 1.5}", "{x_m: 1 kg}")
    (message,) = describe_errors(write(rig=rig)).splitlines()
    assert message.startswith("rig.yaml:3:")
    assert "vehicle.camera.mounts.0.x_m: 'kg' is not a known unit" in message
