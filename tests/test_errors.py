import errno
import pickle

import pytest

from advercity.errors import InputError, RunError, report_write_errors


def test_a_message_has_the_lines_it_was_made_of_whatever_names_it_quotes() -> None:
    error = InputError("lib/a\nb\u2028.yaml: is\x1b[2J missing", "  indented, Grüße\u202e")
    for one in (error, pickle.loads(pickle.dumps(error))):
        assert str(one).splitlines() == [
            r"lib/a\nb\u2028.yaml: is\x1b[2J missing",
            r"  indented, Grüße\u202e",
        ]


@pytest.mark.parametrize(
    ("number", "kind"),
    [(errno.ENOSPC, RunError), (errno.EDQUOT, RunError), (errno.EACCES, InputError)],
)
def test_a_full_disk_is_a_failure_and_a_folder_of_others_bad_input(
    number: int, kind: type[Exception]
) -> None:
    with pytest.raises(kind, match=r"plan\.png: cannot be written"), report_write_errors():
        raise OSError(number, "refused", "plan.png")
