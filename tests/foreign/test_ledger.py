"""What a file of others has and the data have not, by line and name."""

import pytest

from advercity.errors import InputError
from advercity.foreign.ledger import Ledger, describe_left_out, merge_left_out
from advercity.foreign.standards import Standard
from advercity.foreign.xml_documents import get_line, parse_xml

TOY = Standard(
    "toy 1.0",
    {
        "map": {".": "read", "name": "none"},
        "road": {".": "read", "bank": "left out unless 0: bank"},
        "rail": {".": "left out: railway | railways"},
        "sea": {".": "refuse: ships are not cars"},
        "road/height": {".": "read", "v": "read"},
        "rail/height": {".": "read"},
    },
)


def audit(text: str) -> str:
    ledger = Ledger()
    TOY.audit(parse_xml(text.encode()), ledger)
    return describe_left_out(ledger.left_out)


def test_parts_that_are_read_are_not_listed() -> None:
    assert audit('<map name="m"><road bank="0.0"><height v="1"/></road></map>') == ""


def test_parts_that_are_left_out_are_counted_with_the_line_of_the_first() -> None:
    text = '<map>\n<road bank="2"/>\n<rail><height/></rail>\n<rail/></map>'

    assert audit(text) == "1 bank (line 2), 2 railways (line 3)"


def test_an_unknown_element_or_attribute_is_listed_wherever_it_is() -> None:
    text = '<map><road colour="red"><height v="1">\n<hill/></height></road></map>'

    assert audit(text) == (
        "1 unknown attribute road@colour (line 1), 1 unknown element <hill> (line 2)"
    )


def test_a_refused_part_is_named_with_its_line() -> None:
    with pytest.raises(InputError, match=r"line 2: <sea>: ships are not cars"):
        audit("<map>\n<sea/></map>")


def test_records_of_several_files_are_counted_together() -> None:
    first, second = Ledger(), Ledger()
    first.leave_out("tram", at=7, count=2)
    second.leave_out("tram", plural="trams", at=3, count=2)

    assert describe_left_out(merge_left_out(first.left_out, second.left_out)) == "4 trams (line 7)"


def test_a_default_namespace_makes_no_difference() -> None:
    root = parse_xml(b'<map xmlns="http://example.org/x">\n<road bank="0"/></map>')

    assert [item.tag for item in root.iter()] == ["map", "road"]
    assert get_line(root[0]) == 2


def test_a_document_of_more_bytes_than_are_read_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("advercity.foreign.xml_documents.MAX_XML_BYTES", 20)
    assert parse_xml(b"<map>" + b" " * 9 + b"</map>").tag == "map"
    with pytest.raises(InputError, match="has 21 bytes; at most 20 are read"):
        parse_xml(b"<map>" + b" " * 10 + b"</map>")
