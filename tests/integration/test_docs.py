import re
import subprocess
import sys
from pathlib import Path

import pytest
from advercity_dsl import DECLARATIONS

from advercity.compiler.schema import build_schema

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The documentation, built with every warning an error."""
    folder = tmp_path_factory.mktemp("site")
    build = ["sphinx", "-q", "-W", "-n", "--keep-going", "-d", str(folder / "trees")]
    done = subprocess.run(
        [sys.executable, "-m", *build, str(ROOT / "docs"), str(folder / "html")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


def test_the_site_has_the_guides(site: Path) -> None:
    index = (site / "index.html").read_text()
    for guide in (ROOT / "docs" / "guides").glob("*.md"):
        assert f"guides/{guide.stem}.html" in index


@pytest.mark.parametrize("kind", DECLARATIONS)
def test_the_reference_has_every_field(site: Path, kind: str) -> None:
    page = (site / "reference" / f"{kind}.html").read_text()
    for field in build_schema(kind)["properties"].keys() - {"extends", "version"}:
        assert f">{field}</span>" in page


@pytest.mark.parametrize(
    ("guide", "page"),
    [("write_a_conflict", "conflict"), ("write_traffic", "drivers"), ("from_python", "python")],
)
def test_guides_of_the_site_link_to_its_reference(site: Path, guide: str, page: str) -> None:
    assert f'href="../reference/{page}.html"' in (site / "guides" / f"{guide}.html").read_text()


NAMED = re.compile(r"`((?:[\w-]+/)*[\w-]+\.(?:py|glsl|md|yaml)|(?:[\w-]+/){2,})`")


@pytest.mark.parametrize("page", ["ARCHITECTURE.md", "CONTRIBUTING.md"])
def test_files_that_the_architecture_names_exist(page: str) -> None:
    homes = [
        ROOT,
        ROOT / "advercity",
        ROOT / "backends/sapien/advercity_sapien",
        *ROOT.glob("packages/*/advercity_*"),
        *(folder for folder in (ROOT / "advercity").iterdir() if folder.is_dir()),
        ROOT / "dsl/advercity_dsl",
    ]
    named = set(NAMED.findall((ROOT / page).read_text()))
    assert named
    assert {name for name in named if not any((home / name).exists() for home in homes)} == set()


LINK = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)")


PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("docs/[dgm]*/*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_of_pages_lead_somewhere_in_a_clone(page: Path) -> None:
    linked = LINK.findall(page.read_text())
    assert [link for link in linked if not (page.parent / link).exists()] == []


def test_every_decision_has_its_own_number_and_a_row_in_their_index() -> None:
    folder = ROOT / "docs" / "decisions"
    pages = sorted(page.name for page in folder.glob("*.md") if page.name != "index.md")
    assert [page[:4] for page in pages] == [f"{n:04}" for n in range(1, len(pages) + 1)]
    rows = re.findall(r"^\| \[(\d{4})\]\((\S+)\)", (folder / "index.md").read_text(), re.MULTILINE)
    assert rows == [(page[:4], page) for page in pages]


def test_the_container_is_set_up_as_the_install_page_says() -> None:
    steps = (ROOT / "Dockerfile").read_text()
    assert (ROOT / "docs" / "install.md").read_text().count("docker build --tag advercity .") == 1
    assert "make setup" in steps
