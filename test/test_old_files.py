"""What versions up to 0.2.0 wrote is refused in a sentence, and stays or is kept."""

import json

import pytest

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.learning import diary
from wrist_ft_comp.stored import model_file, payload_file, state_file

#: By the name of a file: its kind, what reads it, and what replaces it.
FILES = {
    'model.yaml': (model_file.KIND, model_file.load_model, None),
    'payloads.json': (payload_file.KIND, payload_file.load_payloads, None),
    'state.json': (state_file.KIND, state_file.load_state, None),
    'learning.json': (
        diary.MEMORY, lambda path: diary.load_memory(path.parent),
        lambda path: diary.save_memory(path.parent, diary.Memory()),
    ),
    'days/diary.json': (
        diary.KIND, lambda path: diary.KIND.load(diary.Diary, path),
        lambda path: diary.save_diary(path.parents[1], diary.Diary()),
    ),
}  # fmt: skip


@pytest.mark.parametrize('name', FILES)
def test_an_old_file_is_refused_and_stays_or_is_kept_beside_the_new_one(name, tmp_path):
    kind, load, replace = FILES[name]
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    old = json.dumps({'format': kind.says, 'version': 1, 'since': 'then'})
    path.write_text(old)
    with pytest.raises(WristFtCompError) as refused:
        load(path)
    assert str(refused.value) == (
        f'{path} was written by an older version of wrist_ft_comp (format 1); this one reads '
        f'format {kind.version}. {kind.renewed_by}, or install that one.'
    )
    if replace is not None:
        replace(path)
        load(path)
        path = path.with_name(f'{path.name}.kept')
    assert path.read_text() == old
