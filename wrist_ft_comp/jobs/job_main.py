"""What runs in the process of a job: it reads the job, does it, and answers in plain values."""

from dataclasses import replace
import json
import os
import sys
from threading import Thread
from typing import Any

import numpy as np

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.jobs.calibration_job import calibrate_for_node
from wrist_ft_comp.jobs.job_process import CalibrationJob, end_with
from wrist_ft_comp.jobs.learning_job import learn
from wrist_ft_comp.payload.identify_payload import CHANNELS, identify
from wrist_ft_comp.payload.weight import ForceFrame, payload_line
from wrist_ft_comp.stored.payload_file import add_payloads, IDENTIFIED
from wrist_ft_comp.stored.safe_file import from_plain, parse_json


def answer(job: CalibrationJob) -> dict[str, Any]:
    """Run a job; give its outcome or its refusal in plain values."""
    try:
        if job.history is not None:
            return learn(job)
        if job.minute is not None:
            minute, topics = job.minute, job.topics
            cells = np.array(minute.cells, dtype=float).reshape(-1, CHANNELS)
            sensor = minute.sensor and ForceFrame(np.eye(3), *np.array(minute.sensor))
            payload, frame = identify(cells, minute.period_s, sensor)
            frame = replace(
                frame, source=topics.force_source, force_frame=topics.force_frame,
                wrench_frame=topics.wrench_frame)  # fmt: skip
            (name,) = add_payloads(job.output, IDENTIFIED, [payload], frame, minute.taken)
            message, rotation = payload_line(name, payload), frame.rotation.tolist()
            return {
                'success': True, 'message': f"{message} in the wrench's frame.", 'name': name,
                'rotation': rotation}  # fmt: skip
        return calibrate_for_node(job)
    except (WristFtCompError, OSError) as error:
        return {'success': False, 'message': str(error)}


def main() -> None:
    """Run one job from standard input, at low priority, and write its outcome."""
    os.nice(10)
    Thread(target=end_with, args=(int(sys.argv[1]),), daemon=True).start()
    json.dump(answer(from_plain(CalibrationJob, parse_json(sys.stdin.read()))), sys.stdout)


if __name__ == '__main__':
    main()
