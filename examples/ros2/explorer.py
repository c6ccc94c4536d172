"""A ROS 2 node that asks one question: an action client is the driver of a session.

The features of each behavior are made from the topics of examples/bags/lab.toml, by the code that
made the recordings. The action `Explore` has the goal `behavior`, and the result `state`.
"""

import sys

import rclpy
from action_msgs.msg import GoalStatus
from lab_interfaces.action import Explore
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future

import meal_bayes as mb
from meal_bayes.features import Recorder


class Explorer(Node):
    """Executes what a session chooses, and gives it the features of what the topics said."""

    def __init__(self, session, domain, message_types):
        super().__init__("explorer")
        self.session, self.domain, self.done = session, domain, Future()
        self.recorder = None
        for topic, kind in message_types.items():
            self.create_subscription(kind, topic, lambda m, t=topic: self.on_message(t, m), 50)
        self.client = ActionClient(self, Explore, "explore")
        if not self.client.wait_for_server(timeout_sec=10.0):
            raise TimeoutError("no server of the action 'explore' within 10 s")
        self.send()

    def on_message(self, topic, message):
        if self.recorder is not None:
            self.recorder.add(topic, self.get_clock().now().nanoseconds, message)

    def send(self):
        if self.session.over:
            self.done.set_result(self.session.trial)
            return
        self.recorder = None
        goal = Explore.Goal(behavior=self.session.behavior)
        self.client.send_goal_async(goal).add_done_callback(self.on_goal)

    def on_goal(self, future):
        handle = future.result()
        if not handle.accepted:
            self.session.cancel("the robot refused a goal")
            self.send()
            return
        self.recorder = Recorder(self.domain, self.session.behavior)
        handle.get_result_async().add_done_callback(self.on_result)

    def on_result(self, future):
        answer, recorder = future.result(), self.recorder
        if answer.status == GoalStatus.STATUS_SUCCEEDED:
            features = recorder.features(lambda name, fault: print(f"{name}: {fault}"))
            self.session.observe(mb.Outcome(answer.result.state, features or None))
        else:
            self.session.fail()
        self.send()


def main(domain="lab.toml", recordings="recordings", question="Is it heavy?"):
    # The node itself needs no message types: they are of this lab.
    from audio_common_msgs.msg import AudioData  # noqa: PLC0415
    from sensor_msgs.msg import Image, JointState  # noqa: PLC0415

    rclpy.init()
    learner = mb.Learner(domain, agent="bayes").fit(mb.load_dataset(domain, root=recordings))
    types = {"/camera/image": Image, "/joint_states": JointState, "/audio": AudioData}
    with learner.begin(question) as session:
        explorer = Explorer(session, learner.domain, types)
        rclpy.spin_until_future_complete(explorer, explorer.done)
    print(explorer.done.result().answer)


if __name__ == "__main__":
    main(*[word for word in sys.argv[1:] if not word.startswith("--")][:3])
