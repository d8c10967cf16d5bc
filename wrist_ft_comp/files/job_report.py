"""The report of a calibration job, and the figures of the chamber tables in it."""

from collections.abc import Mapping

from wrist_ft_comp.core.chamber_fit import (
    chamber_figures,
    ChamberFigures,
    compensate_table,
    leave_one_temperature_out,
)
from wrist_ft_comp.files.chamber_table import is_chamber_table, read_chamber_table
from wrist_ft_comp.files.job import CalibrationJob, JobOutcome
from wrist_ft_comp.files.model_file import StoredModel
from wrist_ft_comp.files.report import write_report
from wrist_ft_comp.files.report_calibration import calibration_view

ChamberColumns = dict[str, ChamberFigures]


def report_job(
    job: CalibrationJob, outcome: JobOutcome, tables: Mapping[str, ChamberColumns] | None = None
) -> None:
    """
    Write the report of a job, if it asks for one.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    outcome : JobOutcome
        From run_job.
    tables : mapping, optional
        From judge_chamber_tables; judged here by default.

    Raises
    ------
    RecordingError
        When it cannot be written; the model is saved already.

    """
    if job.report is None:
        return
    tables = judge_chamber_tables(job, outcome.stored) if tables is None else tables
    view = calibration_view(
        outcome.calibration, outcome.recordings, outcome.stored, job.settings.reference, tables
    )
    write_report(job.report, view)


def judge_chamber_tables(job: CalibrationJob, stored: StoredModel) -> dict[str, ChamberColumns]:
    """
    Judge chamber tables: raw, fitted, and every temperature left out in turn.

    Parameters
    ----------
    job : CalibrationJob
        What was fitted.
    stored : StoredModel
        The model.

    Returns
    -------
    dict of str to dict of str to ChamberFigures
        By path, then by title; empty when no recording is a chamber table.

    """
    tables: dict[str, ChamberColumns] = {}
    for path in job.recordings:
        if not is_chamber_table(path):
            continue
        table = read_chamber_table(path, keep_copied_columns=job.keep_copied_columns)
        columns = {
            'raw': chamber_figures(table),
            'fitted': chamber_figures(compensate_table(table, stored.model)),
        }
        left_out = leave_one_temperature_out(table, job.settings, job.period_s)
        if left_out is not None:
            columns['left out'] = chamber_figures(left_out)
        tables[str(path)] = columns
    return tables
