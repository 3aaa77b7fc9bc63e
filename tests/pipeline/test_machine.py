from pathlib import Path

import psutil
import pytest

from advercity.pipeline.machine import (
    build_worker_environment,
    count_usable_cores,
    free_memory_bytes,
    total_memory_bytes,
)


def told(folder: Path, **values: str) -> Path:
    for name, value in values.items():
        (folder / name.replace("_", ".")).write_text(f"{value}\n")
    return folder


def test_a_container_may_use_no_more_cores_than_its_quota(tmp_path: Path) -> None:
    assert count_usable_cores(told(tmp_path, cpu_max="150000 100000")) == 1
    assert count_usable_cores(told(tmp_path, cpu_max="20000 100000")) == 1
    everything = count_usable_cores(told(tmp_path, cpu_max="max 100000"))
    assert count_usable_cores(told(tmp_path, cpu_max=f"{everything}50000 100000")) == everything
    assert count_usable_cores(tmp_path / "none") == everything


def test_a_container_may_take_no_more_memory_than_it_has_left(tmp_path: Path) -> None:
    assert free_memory_bytes(told(tmp_path, memory_max="5000", memory_current="1000")) == 4000
    assert free_memory_bytes(told(tmp_path, memory_max="5000", memory_current="6000")) == 0
    told(tmp_path, memory_stat="anon 1\ninactive_file 700\nslab 2", memory_current="1000")
    assert free_memory_bytes(tmp_path) == 4700
    assert total_memory_bytes(tmp_path) == 5000
    unlimited = free_memory_bytes(told(tmp_path, memory_max="max"))
    assert unlimited == pytest.approx(psutil.virtual_memory().available, rel=0.2)


def test_the_driver_draws_in_threads_only_where_a_worker_has_several_cores() -> None:
    threads = [build_worker_environment(0, (), cores)["LP_NUM_THREADS"] for cores in (8, 2, 1, 0)]
    assert threads == ["8", "2", "0", "0"]
