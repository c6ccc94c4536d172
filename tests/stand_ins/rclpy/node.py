"""A node."""


class Node:
    def __init__(self, node_name):
        self.name = node_name
