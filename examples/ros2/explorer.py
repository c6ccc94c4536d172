"""A ROS 2 node that asks one question: an action client is the driver of a session.

The features of each behavior are made from the topics of examples/bags/lab.toml, by the code that
made the recordings. The action `Explore` has the goal `behavior`, where "where" asks for the state
alone, and the result `state`.
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

TOPICS = ("/camera/image", "/joint_states", "/wrist/wrench", "/wrist/audio")


class Explorer(Node):
    """Executes what a session chooses, and gives it the features of what the topics said.

    The session begins in the state that the robot is in, whatever it held before: the goal "where"
    moves nothing.
    """

    def __init__(self, learner, question, message_types):
        super().__init__("explorer")
        self.learner, self.question, self.done = learner, question, Future()
        self.session = self.recorder = None
        for topic, kind in message_types.items():
            self.create_subscription(kind, topic, lambda m, t=topic: self.on_message(t, m), 50)
        self.client = ActionClient(self, Explore, "explore")
        if not self.client.wait_for_server(timeout_sec=10.0):
            raise TimeoutError("no server of the action 'explore' within 10 s")
        self.send("where")

    def on_message(self, topic, message):
        if self.recorder is not None:
            self.recorder.add(topic, self.get_clock().now().nanoseconds, message)

    def send(self, behavior):
        goal = self.client.send_goal_async(Explore.Goal(behavior=behavior))
        goal.add_done_callback(self.on_goal)

    def on_goal(self, future):
        handle = future.result()
        if not handle.accepted:
            self.stop("the robot refused a goal")
            return
        if self.session is not None:
            self.recorder = Recorder(self.learner.domain, self.session.behavior)
        handle.get_result_async().add_done_callback(self.on_result)

    def on_result(self, future):
        answer, recorder = future.result(), self.recorder
        state = answer.result.state
        self.recorder = None
        if self.session is None:
            self.session = self.learner.begin(self.question, state=state)
        elif self.session.over:  # a late result: the trial was stopped meanwhile
            return
        elif answer.status == GoalStatus.STATUS_SUCCEEDED:
            features = recorder.features(lambda name, fault: print(f"{name}: {fault}"))
            self.session.observe(mb.Outcome(state, features or None))
        else:  # it failed: the state says where the robot is
            self.session.observe(mb.Outcome(state))
        if self.session.over:
            self.done.set_result(self.session.trial)
        else:
            self.send(self.session.behavior)

    def stop(self, why):
        """End the trial, as where the robot refuses a goal or the program ends."""
        if self.session is not None:
            self.session.cancel(why)
        if not self.done.done():
            self.done.set_result(self.session and self.session.trial)


def main(domain="lab.toml", recordings="recordings", question="Is it heavy?"):
    # The node itself needs no message types: they are of this lab.
    from audio_common_msgs.msg import AudioData  # noqa: PLC0415
    from geometry_msgs.msg import WrenchStamped  # noqa: PLC0415
    from sensor_msgs.msg import Image, JointState  # noqa: PLC0415

    rclpy.init()
    learner = mb.Learner(domain, agent="bayes").fit(mb.load_dataset(domain, root=recordings))
    types = dict(zip(TOPICS, (Image, JointState, WrenchStamped, AudioData), strict=True))
    explorer = Explorer(learner, question, types)
    try:
        rclpy.spin_until_future_complete(explorer, explorer.done)
    finally:
        explorer.stop("the program ended")
    trial = explorer.done.result()
    print("the robot refused to begin" if trial is None else trial.answer)


if __name__ == "__main__":
    main(*[word for word in sys.argv[1:] if not word.startswith("--")][:3])
