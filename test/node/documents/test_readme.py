import numpy as np

from wrist_ft_comp.simulation import ft_sensor

#: As a Bota driver and a robot name them.
SENSOR = '/bus0/ft_sensor0/ft_sensor_readings'
THERMOMETERS = (f'{SENSOR}/temperature', '/joint_6/temperature')
SECONDS = 3600
#: When the duty cycle of the motor changes, and to what.
DAYS = {
    'warm_up': {0: 0.0, 300: 0.9, 2100: 0.0, 2850: 0.5},
    'another_day': {0: 0.2, 600: 0.8, 1500: 0.1, 2700: 0.6},
}


def simulate(number, duty):
    """Wrench and temperatures of a day, once a second."""
    rng = np.random.default_rng([1, number])
    sensor = ft_sensor.build_sensor(1)
    cycle = {'duty_start_s': tuple(map(float, duty)), 'duty_level': tuple(duty.values())}
    settings = ft_sensor.RunSettings(**cycle, force_n=0.0, torque_nm=0.0)
    run = ft_sensor.draw_run(settings, rng)
    elapsed_s = np.arange(SECONDS) + 0.5
    drive = ft_sensor.drive(run, elapsed_s)
    true = ft_sensor.true_wrench(run, elapsed_s)
    nodes_c = ft_sensor.trajectory(sensor, drive[0, 1], drive)[:-1]
    measured = ft_sensor.measured_wrench(sensor, nodes_c, true)
    wrench = ft_sensor.digitised_wrench(measured, rng)
    return wrench, ft_sensor.digitised_temperatures(sensor, nodes_c, rng)


def day(messages, number, duty):
    """Messages of a day: topic, type, time and bytes."""
    for second, (wrench, celsius) in enumerate(zip(*simulate(number, duty), strict=True)):
        at_ns = (number * 86_400 + second) * 10**9
        yield f'{SENSOR}/wrench', messages.wrench_type, at_ns, messages.wrench(at_ns, wrench)
        for topic, value in zip(THERMOMETERS, celsius, strict=True):
            yield topic, messages.temperature_type, at_ns, messages.temperature(at_ns, value)


def write_log(path, number, duty):
    """Write a day as somebody else's logger does: ISO times, kN, degrees Fahrenheit."""
    lines = ['time,fx,fz,temp']
    for second, (wrench, celsius) in enumerate(zip(*simulate(number, duty), strict=True)):
        time = f'2026-11-20T08:{second // 60:02d}:{second % 60:02d}Z'
        force = f'{wrench[0] / 1000:.7f},{wrench[2] / 1000:.7f}'
        lines.append(f'{time},{force},{celsius[0] * 1.8 + 32:.3f}')
    path.write_text('\n'.join(lines) + '\n')


def test_the_readme_s_commands_run_and_give_its_figures(terminal, play, messages):
    for number, (name, duty) in enumerate(DAYS.items(), start=1):
        messages.write(terminal.folder / name, day(messages, number, duty), 'mcap')
    write_log(terminal.folder / 'log.csv', 1, DAYS['warm_up'])
    documents = 'README.md', 'docs/running.md', 'docs/files.md'
    assert play(lambda heat: heat.temperature > 28.0, *documents) >= 10.0
