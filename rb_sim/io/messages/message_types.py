"""The ROS 2 message types that rb_sim publishes and records: fields and type hashes.

Kept here, because a bag must name them where no ROS is installed. The definitions hold the fields
and nothing else; the hashes (RIHS01, REP 2016) are those of ROS 2 Jazzy.
"""

from __future__ import annotations

ACCEL_STAMPED = "geometry_msgs/msg/AccelStamped"
CLOCK = "rosgraph_msgs/msg/Clock"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
FLOAT64 = "std_msgs/msg/Float64"
JOINT_STATE = "sensor_msgs/msg/JointState"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
STRING = "std_msgs/msg/String"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
UINT8 = "std_msgs/msg/UInt8"
WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"

FIELDS: dict[str, tuple[str, ...]] = {
    "builtin_interfaces/msg/Duration": ("int32 sec", "uint32 nanosec"),
    "builtin_interfaces/msg/Time": ("int32 sec", "uint32 nanosec"),
    "diagnostic_msgs/msg/DiagnosticStatus": (
        "byte level",
        "string name",
        "string message",
        "string hardware_id",
        "KeyValue[] values",
    ),
    "diagnostic_msgs/msg/KeyValue": ("string key", "string value"),
    "geometry_msgs/msg/Accel": ("Vector3 linear", "Vector3 angular"),
    "geometry_msgs/msg/Point": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/msg/Pose": ("Point position", "Quaternion orientation"),
    "geometry_msgs/msg/PoseWithCovariance": ("Pose pose", "float64[36] covariance"),
    "geometry_msgs/msg/Quaternion": ("float64 x 0", "float64 y 0", "float64 z 0", "float64 w 1"),
    "geometry_msgs/msg/Transform": ("Vector3 translation", "Quaternion rotation"),
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header",
        "string child_frame_id",
        "Transform transform",
    ),
    "geometry_msgs/msg/Twist": ("Vector3 linear", "Vector3 angular"),
    "geometry_msgs/msg/TwistWithCovariance": ("Twist twist", "float64[36] covariance"),
    "geometry_msgs/msg/Vector3": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/msg/Wrench": ("Vector3 force", "Vector3 torque"),
    "sensor_msgs/msg/CompressedImage": (
        "std_msgs/Header header",
        "string format",
        "uint8[] data",
    ),
    "std_msgs/msg/ColorRGBA": ("float32 r", "float32 g", "float32 b", "float32 a"),
    "std_msgs/msg/Header": ("builtin_interfaces/Time stamp", "string frame_id"),
    "visualization_msgs/msg/Marker": (
        "std_msgs/Header header",
        "string ns",
        "int32 id",
        "int32 type",
        "int32 action",
        "geometry_msgs/Pose pose",
        "geometry_msgs/Vector3 scale",
        "std_msgs/ColorRGBA color",
        "builtin_interfaces/Duration lifetime",
        "bool frame_locked",
        "geometry_msgs/Point[] points",
        "std_msgs/ColorRGBA[] colors",
        "string texture_resource",
        "sensor_msgs/CompressedImage texture",
        "UVCoordinate[] uv_coordinates",
        "string text",
        "string mesh_resource",
        "MeshFile mesh_file",
        "bool mesh_use_embedded_materials",
    ),
    "visualization_msgs/msg/MeshFile": ("string filename", "uint8[] data"),
    "visualization_msgs/msg/UVCoordinate": ("float32 u", "float32 v"),
    ACCEL_STAMPED: ("std_msgs/Header header", "Accel accel"),
    CLOCK: ("builtin_interfaces/Time clock",),
    DIAGNOSTIC_ARRAY: ("std_msgs/Header header", "DiagnosticStatus[] status"),
    FLOAT64: ("float64 data",),
    JOINT_STATE: (
        "std_msgs/Header header",
        "string[] name",
        "float64[] position",
        "float64[] velocity",
        "float64[] effort",
    ),
    MARKER_ARRAY: ("Marker[] markers",),
    ODOMETRY: (
        "std_msgs/Header header",
        "string child_frame_id",
        "geometry_msgs/PoseWithCovariance pose",
        "geometry_msgs/TwistWithCovariance twist",
    ),
    POSE_STAMPED: ("std_msgs/Header header", "Pose pose"),
    STRING: ("string data",),
    TF_MESSAGE: ("geometry_msgs/TransformStamped[] transforms",),
    TWIST_STAMPED: ("std_msgs/Header header", "Twist twist"),
    UINT8: ("uint8 data",),
    WRENCH_STAMPED: ("std_msgs/Header header", "Wrench wrench"),
}
"""Fields of each type, in wire order."""

TYPE_HASHES: dict[str, str] = {
    ACCEL_STAMPED: "RIHS01_ef1df9eabae0a708cc049a061ebcddc4e2a5f745730100ba680e086a9698b165",
    CLOCK: "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    DIAGNOSTIC_ARRAY: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    FLOAT64: "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
    JOINT_STATE: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    MARKER_ARRAY: "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    ODOMETRY: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    POSE_STAMPED: "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    STRING: "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    TF_MESSAGE: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    TWIST_STAMPED: "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    UINT8: "RIHS01_6138bd83d8c3569cb80a667db03cfc1629f529fee79d944c39c34e352e72f010",
    WRENCH_STAMPED: "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
}
"""Hash of each published type."""

_SEPARATOR = "=" * 80


def schema_text(ros_type: str) -> str:
    """Definition of `ros_type` and of all types in it, breadth first, in MCAP's ros2msg form."""
    used = [ros_type]
    for name in used:  # grows while it runs
        used += [part for part in _parts(name) if part not in used]
    head, *rest = used
    blocks = ["\n".join(FIELDS[head])]
    blocks += [f"MSG: {_short(name)}\n" + "\n".join(FIELDS[name]) for name in rest]
    return f"\n{_SEPARATOR}\n".join(blocks) + "\n"


def _parts(ros_type: str) -> list[str]:
    """Full names of the message types among the fields of `ros_type`."""
    package = ros_type.split("/")[0]
    parts = []
    for field in FIELDS[ros_type]:
        written = field.split()[0].removesuffix("[]")
        full = f"{package}/{written}" if "/" not in written else written
        full = full.replace("/", "/msg/", 1)
        if full in FIELDS:
            parts.append(full)
    return list(dict.fromkeys(parts))


def _short(ros_type: str) -> str:
    """pkg/msg/Type as pkg/Type."""
    return ros_type.replace("/msg/", "/")
