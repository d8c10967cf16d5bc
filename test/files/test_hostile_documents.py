"""Documents that are well-formed and mean harm: only the package's own errors, and soon."""

import json
from pathlib import Path
from typing import Any

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest
import yaml

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
PLAIN = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
LEAVES = PLAIN | st.binary(max_size=3)


def trees(leaves: Any) -> Any:
    return st.recursive(
        leaves,
        lambda inner: st.lists(inner, max_size=6) | st.dictionaries(NAMES, inner, max_size=6),
        max_leaves=15,
    )


many = settings(
    deadline=None,
    max_examples=100,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@many
@given(extra=st.dictionaries(NAMES, trees(PLAIN)))
def test_a_state_of_any_form_is_refused(tmp_path: Path, extra: dict[str, Any]) -> None:
    document = {'format': state_file.KIND.says, 'version': state_file.KIND.version}
    path = tmp_path / 'state.json'
    path.write_text(json.dumps({**extra, **document}), encoding='utf-8')
    with pytest.raises(StateFileError):
        load_state(path)


@many
@given(extra=st.dictionaries(NAMES, trees(LEAVES)))
def test_a_model_of_any_form_is_refused(tmp_path: Path, extra: dict[str, Any]) -> None:
    document = {'format': model_file.KIND.says, 'version': model_file.KIND.version}
    path = tmp_path / 'model.yaml'
    path.write_text(yaml.safe_dump({**extra, **document}), encoding='utf-8')
    with pytest.raises(ModelFileError):
        load_model(path)


@many
@given(document=trees(PLAIN))
def test_a_list_of_models_of_any_form_is_read_or_refused(tmp_path: Path, document: Any) -> None:
    (tmp_path / 'active.json').write_text(json.dumps(document), encoding='utf-8')
    store = ModelStore(tmp_path)
    assert isinstance(store.given(), str)
    try:
        entries = store.history()
    except ModelFileError:
        return
    assert isinstance(document, list | dict)
    assert all(entry is None or isinstance(entry, Path) for entry in entries)
