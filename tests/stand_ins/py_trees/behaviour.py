"""A leaf of a tree."""

from py_trees.common import Status


class Behaviour:
    def __init__(self, name):
        self.name = name
        self.status = Status.INVALID

    def tick_once(self):
        if self.status != Status.RUNNING:
            self.initialise()
        self.status = self.update()
        if self.status != Status.RUNNING:
            self.stop(self.status)

    def stop(self, new_status):
        self.terminate(new_status)
        self.status = new_status
