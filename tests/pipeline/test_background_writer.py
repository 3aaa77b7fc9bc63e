import threading

import pytest

from advercity.pipeline.scenario import open_background_writer


def test_jobs_are_done_in_order_in_another_thread() -> None:
    done: list[tuple[int, bool]] = []
    with open_background_writer() as behind:
        for number in range(5):
            behind.submit(
                lambda number=number: done.append(
                    (number, threading.current_thread() is threading.main_thread())
                )
            )
    assert done == [(number, False) for number in range(5)]


def fail() -> None:
    raise OSError("full")


def test_an_error_is_raised_by_the_next_call() -> None:
    done: list[int] = []
    with pytest.raises(OSError, match="full"), open_background_writer() as behind:
        behind.submit(fail)
        behind.submit(lambda: done.append(1))
    assert done == []


def test_an_error_of_the_last_job_is_raised_at_the_end() -> None:
    with pytest.raises(OSError, match="full"), open_background_writer() as behind:
        behind.submit(fail)


def test_an_error_outside_lets_the_job_finish_first() -> None:
    done: list[int] = []
    started = threading.Event()

    def slow() -> None:
        started.wait(5)
        done.append(1)

    with pytest.raises(KeyError), open_background_writer() as behind:
        behind.submit(slow)
        started.set()
        raise KeyError
    assert done == [1]
