"""Writes the contents of a report as one HTML page."""

from base64 import b64encode
from importlib.metadata import version
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from advercity.output_files import check_is_outside_scenarios, open_output
from advercity_report.contents import Picture, ReportContents, collect_report

TEMPLATES = Environment(
    loader=PackageLoader("advercity_report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_report(dataset: Path, output: Path) -> None:
    """Write one HTML page about a dataset; it needs no other file and no network.

    Args:
        dataset: Folder of a dataset, or of one scenario.
        output: The file.

    Raises:
        InputError: There is no dataset, it has no frames, or the file is not to be replaced.
        RunError: The file cannot be written.
    """
    check_is_outside_scenarios(output)
    page = format_report(collect_report(dataset))
    with open_output(output) as partial:
        partial.write_text(page, encoding="utf-8")


def format_report(contents: ReportContents) -> str:
    """Format a report as HTML; texts of the dataset are escaped."""
    template = TEMPLATES.get_template("report.html.j2")
    return template.render(
        report=contents,
        version=version("advercity"),
        to_url=_to_url,
        format_cell=_format_cell,
    )


def _to_url(picture: Picture) -> str:
    return f"data:{picture.media_type};base64,{b64encode(picture.data).decode()}"


def _format_cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
