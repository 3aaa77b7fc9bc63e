"""Untrusted XML and networks: limits, and what passes."""

import base64
import zlib

import pytest

from advercity.errors import InputError
from advercity.foreign.xml_documents import MAX_XML_BYTES, parse_xml, to_xml_bytes
from advercity.roads.sumo_xml import pack_network, unpack_network


def test_a_huge_file_is_refused_unparsed() -> None:
    with pytest.raises(InputError, match="at most"):
        parse_xml(b" " * (MAX_XML_BYTES + 1))


def test_a_network_that_inflates_without_end_is_refused() -> None:
    bomb = base64.b64encode(zlib.compress(b" " * (MAX_XML_BYTES + 1), 9)).decode()

    with pytest.raises(InputError, match="inflates to more than"):
        unpack_network(bomb)


def test_a_network_brings_nothing_that_writes_files() -> None:
    hostile = b"""<net version="1.20">
      <location netOffset="0,0" projParameter="+proj=tmerc +nadgrids=/etc/passwd"/>
      <e1Detector id="d" lane="a_0" freq="1" file="out.xml"/>
      <edge id="a" from="x" to="y"><param key="k" value="v"/>
        <lane id="a_0" index="0" speed="1" length="9" shape="0,0 9,0"/></edge>
      <tlLogic id="t" type="actuated" programID="0" offset="0">
        <param key="file" value="out.xml"/><phase duration="9" state="G"/></tlLogic>
    </net>"""

    kept = to_xml_bytes(unpack_network(pack_network(parse_xml(hostile)))).decode()

    assert 'id="a_0"' in kept
    assert 'type="static"' in kept
    for word in ("Detector", "out.xml", "param key", "passwd", "actuated"):
        assert word not in kept
