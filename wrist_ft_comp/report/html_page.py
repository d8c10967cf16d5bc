"""The page: one self-contained HTML text that says how good a model is, and shows why."""

from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.fit.result import Calibration
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.report import report_content
from wrist_ft_comp.report.verdict import LEVEL_NAMES
from wrist_ft_comp.series import rounded
from wrist_ft_comp.stored.safe_file import Output

#: What every page names as its generator, by which it is known again.
GENERATOR = 'wrist_ft_comp report'
REPORT = Output(
    name='report', endings='.html .htm',
    begins='<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
    f'<meta name="generator" content="{GENERATOR}">')  # fmt: skip


def page(view: report_content.ReportContent) -> str:
    """Write the page: HTML that loads nothing; its script only shows numbers of its pictures."""
    from wrist_ft_comp.report import pictures  # noqa: PLC0415 -- matplotlib

    environment = Environment(
        loader=PackageLoader('wrist_ft_comp.report'), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True)  # fmt: skip
    environment.filters['svg'] = pictures.svg_text
    environment.globals.update(
        content=report_content, generator=GENERATOR, levels=LEVEL_NAMES, number=rounded,
        pictures=pictures, zip=zip)  # fmt: skip
    return environment.get_template('report.html.j2').render(view=view)


def write_report(
    path: Path | str, stored: StoredModel, calibration: Calibration,
    recordings: Sequence[Recording],
) -> None:  # fmt: skip
    """Write the report of a calibration that was saved; OutputError over what is no report."""
    content = report_content.calibration_content(calibration, recordings, stored)
    REPORT.write(Path(path), page(content))
