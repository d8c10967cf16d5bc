def test_the_tutorial_runs_and_another_day_has_a_fifth_of_the_drift(terminal, play, commands):
    assert play(lambda heat: heat.header.stamp.sec % 86400 > 2100, 'docs/tutorial.md') >= 5.0
    for words in commands('docs/recording.md'):
        terminal.run(words)
