"""Programs of others that a command runs end with it."""

import resource
import subprocess
import sys

import psutil
import pytest

from advercity.processes import MISSING_PROGRAM, bind_to_this_process, describe_end

START_A_SLEEPER = """
import subprocess, time
from advercity.processes import bind_to_this_process
child = subprocess.Popen(bind_to_this_process(["/bin/sh", "-c", "echo $$; exec sleep 600"]))
time.sleep(600)
"""


def test_a_program_ends_with_the_process_that_runs_it() -> None:
    """However that ends: nobody is left to end it after a SIGKILL."""
    with subprocess.Popen(
        [sys.executable, "-c", START_A_SLEEPER], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        program = psutil.Process(int(parent.stdout.readline()))
        parent.kill()
        program.wait(timeout=20)
    assert not program.is_running()


def test_a_program_has_the_exit_code_and_output_that_it_would_have_had() -> None:
    command = ["/bin/sh", "-c", 'echo "$1"; exit 3', "sh", "a b"]
    done = subprocess.run(bind_to_this_process(command), capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (3, b"a b\n")


def test_a_program_that_is_not_there_is_named() -> None:
    command = bind_to_this_process(["/nowhere/program"])
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == MISSING_PROGRAM
    assert done.stderr == "/nowhere/program: No such file or directory\n"


@pytest.mark.parametrize(
    ("limit", "limit_bytes", "exit_code", "text"),
    [
        (resource.RLIMIT_AS, resource.RLIM_INFINITY, 3, "exit code 3"),
        (resource.RLIMIT_AS, 2_000_000_000, 3, "exit code 3"),
        (resource.RLIMIT_AS, resource.RLIM_INFINITY, -11, "killed by SIGSEGV"),
        (resource.RLIMIT_AS, 2_000_000_000, -9, "killed by SIGKILL"),
        (
            resource.RLIMIT_AS,
            2_040_000_000,
            -11,
            "killed by SIGSEGV where `ulimit -v` leaves 2.0 GB of addresses; allow more",
        ),
        (
            resource.RLIMIT_AS,
            960_000_000,
            -6,
            "killed by SIGABRT where `ulimit -v` leaves 1.0 GB of addresses; allow more",
        ),
        (
            resource.RLIMIT_FSIZE,
            204_800,
            -7,
            "killed by SIGBUS where `ulimit -f` leaves 0.2 MB for a file; allow more",
        ),
        (resource.RLIMIT_FSIZE, 204_800, -11, "killed by SIGSEGV"),
    ],
)
def test_a_crash_under_a_limit_names_the_limit(
    limit: int, limit_bytes: int, exit_code: int, text: str, monkeypatch: pytest.MonkeyPatch
):
    def getrlimit(kind: int) -> tuple[int, int]:
        bound = limit_bytes if kind == limit else resource.RLIM_INFINITY
        return bound, bound

    monkeypatch.setattr(resource, "getrlimit", getrlimit)
    assert describe_end(exit_code) == text
