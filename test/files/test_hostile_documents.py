"""Documents that are well-formed and mean harm: only the package's own errors, and soon."""

import json
from pathlib import Path

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest

from wrist_ft_comp.errors import ModelFileError, StateFileError
from wrist_ft_comp.files import model_file, state_file
from wrist_ft_comp.files.model_file import load_model
from wrist_ft_comp.files.model_store import ModelStore
from wrist_ft_comp.files.state_file import load_state

NAMES = st.sampled_from([
    'format', 'version', 'tare', 'thermal', 'filters', 'axes', 'force_z', 'model', 'features', 'a',
    'dynamics', 'latents', 'b', 'end_ns', 'history', 'cells', 'period_ns', 'thermometers', 'given',
    'range_c', 'input_mean', 'rotations', 'saved_ns', 'model_sha256', 'provenance', 'warnings',
])  # fmt: skip
LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
TREES = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=6) | st.dictionaries(NAMES, inner, max_size=6),
    max_leaves=15,
)


many = settings(
    deadline=None,
    max_examples=100,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.mark.parametrize(
    ('kind', 'load', 'error'),
    [
        (state_file.KIND, load_state, StateFileError),
        (model_file.KIND, load_model, ModelFileError),
    ],
    ids=['state', 'model'],
)
@many
@given(extra=st.dictionaries(NAMES, TREES))
def test_a_document_of_any_form_is_refused(tmp_path, kind, load, error, extra):
    path = tmp_path / 'file'
    document = {**extra, 'format': kind.says, 'version': kind.version}
    path.write_text(json.dumps(document), encoding='utf-8')  # every JSON is YAML
    with pytest.raises(error):
        load(path)


@many
@given(document=TREES)
def test_a_list_of_models_of_any_form_is_read_or_refused(tmp_path, document):
    (tmp_path / 'active.json').write_text(json.dumps(document), encoding='utf-8')
    store = ModelStore(tmp_path)
    assert isinstance(store.given(), str)
    try:
        entries = store.history()
    except ModelFileError:
        return
    assert isinstance(document, list | dict)
    assert all(entry is None or isinstance(entry, Path) for entry in entries)
