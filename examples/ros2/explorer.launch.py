"""Start the explorer: ``ros2 launch explorer.launch.py question:="Is it full?"``."""

import sys
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description():
    defaults = {"domain": "lab.toml", "recordings": "recordings", "question": "Is it heavy?"}
    program = [sys.executable, str(Path(__file__).with_name("explorer.py"))]
    words = [LaunchConfiguration(name) for name in defaults]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(name, default_value=text) for name, text in defaults.items()),
            ExecuteProcess(cmd=[*program, *words], output="screen"),
        ]
    )
