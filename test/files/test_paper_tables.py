"""What docs/paper.md says of the published tables."""

from pathlib import Path

from wrist_ft_comp.files.chamber_table import read_chamber_table

TABLES = Path(__file__).parents[2] / 'data' / 'keller_pa10'
PAIRS = (
    ('table1_sensor_a_raw.csv', 'table3_sensor_a_compensated.csv'),
    ('table2_sensor_b_raw.csv', 'table4_sensor_b_compensated.csv'),
)


def test_the_compensated_tables_are_no_function_of_output_and_temperature() -> None:
    for raw_name, compensated_name in PAIRS:
        raw, compensated = (
            read_chamber_table(TABLES / name, keep_copied_columns=True).output
            for name in (raw_name, compensated_name)
        )
        contradictions = 0
        for column in range(raw.shape[1]):
            seen: dict[float, float] = {}
            for output, result in zip(raw[:, column], compensated[:, column], strict=True):
                contradictions += seen.setdefault(output, result) != result
        assert contradictions > 0, raw_name


def test_sensor_a_reads_the_same_twice_and_the_paper_compensates_it_to_two_values() -> None:
    raw = read_chamber_table(TABLES / PAIRS[0][0]).output
    compensated = read_chamber_table(TABLES / PAIRS[0][1]).output
    assert raw[0, 0] == raw[-1, 0] == -5.6
    assert (compensated[0, 0], compensated[-1, 0]) == (3.949, 3.918)
