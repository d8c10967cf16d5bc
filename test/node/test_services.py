import queue

from moments import TIMEOUT_S
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from wrist_ft_comp.ros.services import DeferredService, Service


class Example(Node):
    """Hands out its replies, and answers them in the executor's thread when a test lets it."""

    def __init__(self, **kwargs):
        super().__init__('example', use_global_arguments=False, **kwargs)
        self.replies, self.todo, self.ticks = queue.Queue(), queue.Queue(), queue.Queue()
        work = Service('~/work', 'works', SetBool, self.on_work)
        at_once = Service('~/at_once', 'answers', Trigger, self.on_at_once)
        self.service = DeferredService(self, work, self.on_work)
        self.at_once = DeferredService(self, at_once, self.on_at_once)
        self.create_timer(0.005, self.tick)

    def on_work(self, request, reply):
        self.replies.put((request, reply))

    def on_at_once(self, _request, reply):
        reply(success=True, message='first')

    def tick(self):
        self.ticks.put(None)
        while not self.todo.empty():
            self.todo.get()()


def test_answers_reach_their_askers_in_any_order(bench):
    node = bench.start(Example, executor='events')
    flags = True, False, True
    asked = [bench.ask(SetBool, '/example/work', SetBool.Request(data=flag)) for flag in flags]
    waiting = [node.replies.get(timeout=TIMEOUT_S) for _ in asked]
    for _ in range(20):
        node.ticks.get(timeout=TIMEOUT_S)  # callbacks go on meanwhile
    assert all(answers.empty() for answers in asked)
    for request, reply in reversed(waiting):
        text = str(request.data)
        node.todo.put(lambda reply=reply, text=text: reply(success=True, message=text))
    got = [answers.get(timeout=TIMEOUT_S).message for answers in asked]
    assert got == ['True', 'False', 'True']
    assert all(answers.empty() for answers in asked)


def test_each_of_twenty_callers_at_once_is_answered_and_no_reply_is_kept(bench):
    node, deep = bench.make(Example), QoSProfile(depth=1000)  # every client hears all answers
    name = '/example/at_once'
    clients = [bench.helper.create_client(Trigger, name, qos_profile=deep) for _ in range(20)]
    assert all(client.wait_for_service(timeout_sec=TIMEOUT_S) for client in clients)
    answers = [client.call_async(Trigger.Request()) for client in clients]
    executor = SingleThreadedExecutor(context=bench.context)
    executor.add_node(node)
    bench.wait_until(
        lambda: executor.spin_once(timeout_sec=0.0) or all(one.done() for one in answers),
        'all answers',
    )
    assert {answer.result().message for answer in answers} == {'first'}
    assert node.at_once._asked == {}
    executor.shutdown()
