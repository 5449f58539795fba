# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start the node on a scene: ros2 launch rb_sim rb_sim.launch.py scene:=PATH [params:=PATH]."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    """One node; its parameters come from the YAML file, the scene from the argument."""
    share = FindPackageShare("rb_sim")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "scene",
                default_value=PathJoinSubstitution(
                    [share, "config", "rolling_sphere_commanded.yaml"]
                ),
                description="scene file",
            ),
            DeclareLaunchArgument(
                "params",
                default_value=PathJoinSubstitution([share, "config", "rb_sim_node.params.yaml"]),
                description="YAML file of node parameters",
            ),
            DeclareLaunchArgument("namespace", default_value="", description="of the node"),
            DeclareLaunchArgument(
                "managed",
                default_value="false",
                description="true: a lifecycle node, which waits for configure and activate",
            ),
            Node(
                package="rb_sim",
                executable="rb_sim_node",
                name="rb_sim",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    LaunchConfiguration("params"),
                    {
                        "scene": LaunchConfiguration("scene"),
                        "managed": ParameterValue(LaunchConfiguration("managed"), value_type=bool),
                    },
                ],
                output="screen",
            ),
        ]
    )
