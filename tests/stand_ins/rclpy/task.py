"""Futures whose callbacks run while somebody spins, as rclpy's executor runs them."""

from rclpy import QUEUE


class Future:
    def __init__(self):
        self._done = False
        self._result = None
        self._callbacks = []

    def done(self):
        return self._done

    def result(self):
        return self._result

    def set_result(self, result):
        self._done = True
        self._result = result
        for callback in self._callbacks:
            QUEUE.append(lambda callback=callback: callback(self))

    def add_done_callback(self, callback):
        if self._done:
            QUEUE.append(lambda: callback(self))
        else:
            self._callbacks.append(callback)
