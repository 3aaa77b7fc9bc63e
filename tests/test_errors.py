import pickle

from advercity.errors import InputError


def test_a_message_has_the_lines_it_was_made_of_whatever_names_it_quotes() -> None:
    error = InputError("lib/a\nb\u2028.yaml: is\x1b[2J missing", "  indented, Grüße\u202e")
    for one in (error, pickle.loads(pickle.dumps(error))):
        assert str(one).splitlines() == [
            r"lib/a\nb\u2028.yaml: is\x1b[2J missing",
            r"  indented, Grüße\u202e",
        ]
