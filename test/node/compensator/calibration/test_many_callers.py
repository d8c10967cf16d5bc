"""Twenty who call at once: the service's queue holds them all, and each gets an answer."""

import threading

from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.node.compensator_node import CompensatorNode

CALLERS = 20
TIMEOUT_S = 60.0


def ask_all(bench, kind, name, request):
    """Call a service from as many clients, one after the other, without waiting for answers."""
    # Every client hears the answers to all of them, and here one thread takes them all.
    deep = QoSProfile(depth=1000)
    clients = [bench.helper.create_client(kind, name, qos_profile=deep) for _ in range(CALLERS)]
    assert all(client.wait_for_service(timeout_sec=TIMEOUT_S) for client in clients)
    return [client.call_async(request) for client in clients]


def test_each_of_twenty_is_answered(bench, tmp_path):
    node = bench.make(
        CompensatorNode, namespace='/many', parameters={'data_directory': str(tmp_path)}
    )
    asked = {
        name: ask_all(bench, kind, f'/many/wrist_ft_comp/{name}', kind.Request())
        for name, kind in (
            ('tare', Trigger),
            ('calibrate', Trigger),
            ('rollback', Trigger),
            ('record', SetBool),
        )
    }
    # Only now does somebody serve them: all are in the queues.
    executor = SingleThreadedExecutor(context=bench.context)
    executor.add_node(node)
    done = threading.Event()

    def serve():
        while not done.is_set():
            executor.spin_once(timeout_sec=0.05)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        for name, answers in asked.items():
            bench.wait_until(lambda those=answers: all(f.done() for f in those), name)
    finally:
        done.set()
        thread.join(TIMEOUT_S)
        executor.shutdown()
    said = {name: [f.result().message for f in answers] for name, answers in asked.items()}
    assert said['tare'].count('A tare is running; wait for its answer, then call again.') == 19
    assert all(message.startswith('There is no recording in') for message in said['calibrate'])
    assert all('no earlier model' in message for message in said['rollback'])
    assert all(message.startswith('No recording runs') for message in said['record'])
