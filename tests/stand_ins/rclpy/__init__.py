"""A stand-in for rclpy: callbacks wait in a queue, and run while somebody spins."""

from collections import deque

QUEUE = deque()


def init():
    """Begin."""


def spin_until_future_complete(node, future):
    """Run callbacks in order until a future is done."""
    while not future.done():
        QUEUE.popleft()()
