from pathlib import Path

INTERFACE = Path(__file__).parents[2] / 'docs/interface.md'


def test_the_reference_of_the_interface_is_what_the_code_says(run_python):
    generated = run_python('docs/generator/interface.py')
    assert generated == INTERFACE.read_text('utf-8'), 'write it anew: make docs'
