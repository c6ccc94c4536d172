"""An action client of a server that refuses nothing and fails every third goal."""

from types import SimpleNamespace

from action_msgs.msg import GoalStatus

from rclpy import QUEUE
from rclpy.task import Future


class ActionClient:
    def __init__(self, node, action_type, action_name):
        self.action = action_type
        self.goals = 0

    def wait_for_server(self, timeout_sec=None):
        return True

    def send_goal_async(self, goal):
        future = Future()
        self.goals = self.goals + 1
        fails = self.goals % 3 == 0
        result = Future()
        handle = SimpleNamespace(accepted=True, get_result_async=lambda: result)
        QUEUE.append(lambda: future.set_result(handle))
        status = GoalStatus.STATUS_ABORTED if fails else GoalStatus.STATUS_SUCCEEDED
        answer = SimpleNamespace(status=status, result=self.action.execute(goal, fails))
        QUEUE.append(lambda: result.set_result(answer))
        return future
