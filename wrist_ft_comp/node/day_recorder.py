"""The diary: what the node records of every day, as ``~/record`` does."""

import time

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.learning.day_files import DayFiles, SILENCE_NS
from wrist_ft_comp.node.recorder import OwnRecording, Recorder
from wrist_ft_comp.ros.node_log import NodeLog
from wrist_ft_comp.signals import NANOSECONDS

#: After a disk that refused, s.
_TRY_AGAIN_S = 60.0


class DiaryKeeper:
    """Keeps days, as long as the disk takes them, and tries again later when it does not."""

    def __init__(self, recorder: Recorder, files: DayFiles, log: NodeLog) -> None:
        #: Why nothing is being kept; empty when something is.
        self.problem = ''
        #: Rows that were written since the start.
        self.rows = 0
        self.files = files
        self._recorder, self._log = recorder, log
        self._recording: OwnRecording | None = None
        self._wait_until = self._heard = time.monotonic()
        self._begin()

    def poll(self) -> None:
        """Record, unless the disk refused just now; a silence ends the day."""
        now, recording = time.monotonic(), self._recording
        if recording is None:
            if now >= self._wait_until:
                self._begin()
        elif recording.rows:
            self.rows, recording.rows = self.rows + recording.rows, 0
            self._heard, self.problem = now, ''
        if self.files.path is not None and now - self._heard > SILENCE_NS / NANOSECONDS:
            self.end_day()

    def _begin(self) -> None:
        """Take part in what comes."""
        self._recording = self._recorder.begin(self.files, self._fail, self._follow_period)

    def _follow_period(self) -> None:
        """Go on with rows of other thermal cells, which a new model has brought."""
        self.end()
        self._begin()

    def _fail(self, error: RecordingError) -> None:
        """Rest for a while."""
        self._recording, self._wait_until = None, time.monotonic() + _TRY_AGAIN_S
        if not self.problem:
            self._log.error(f'The diary rests: {error}')
        self.problem = f'{error} Nothing is kept of the day until there is room'

    def end_day(self) -> None:
        """End the day, if one goes on; the next row begins another."""
        self.end()
        try:
            self.files.leave()
        except RecordingError as error:
            self._fail(error)
        else:
            self._begin()

    def end(self) -> None:
        """Write what there is, and close; the day goes on when recording does."""
        recording, self._recording = self._recording, None
        if recording is None:
            return
        self._recorder.leave(recording)
        try:
            recording.close()
        except RecordingError as error:
            self._fail(error)
