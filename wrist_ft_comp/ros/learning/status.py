"""What the diagnostics say of learning."""

from collections.abc import Iterator

from wrist_ft_comp.ros.learning.learning import Learner
from wrist_ft_comp.ros.node_log import OK, Status, WARN


def learning_status(learner: Learner) -> Iterator[Status]:
    """Judge how it stands; nothing is said where learning is off."""
    if learner.mode == 'off':
        return
    numbers = _numbers(learner)
    memory, resting = learner.memory, learner.diary.problem if learner.diary else ''
    # What a person should look at, the worst first.
    trouble = learner.why_not or resting or learner.problem or memory.paused or memory.incident
    yield Status('learning', WARN if trouble else OK, trouble or _well(learner), numbers)


def _well(learner: Learner) -> str:
    """Say what is going on."""
    if learner.memory.offered:
        return 'a better model is offered: see "offered", and call ~/adopt to make it live'
    if learner.running_s is not None:
        return f'learning for {learner.running_s:.0f} s'
    return learner.waiting or 'keeping a diary'


def _numbers(learner: Learner) -> dict[str, str]:
    """Give what stands behind it."""
    memory = learner.memory
    numbers = {
        'mode': learner.mode,
        'last_day': f'{memory.judged}: {memory.verdict}' if memory.verdict else 'none yet',
        'last_change': memory.change or 'none yet',
    }
    if memory.offered:
        report = str(learner.offered.with_suffix('.html'))
        numbers |= {'offered': str(learner.offered), 'why': memory.why, 'report': report}
    if learner.diary is not None:
        files = learner.diary.files
        numbers |= {
            'days': str(len(files.ended())),
            'megabytes': f'{files.used() / 1e6:.1f}',
            'today': files.path.name if files.path else 'none yet',
            'cells': str(learner.diary.rows),
        }
    return numbers
