"""Messages of the published interface that describe a skill's parts.

Scripts can make them and read them; no skill here is made of them: the parts of frankapy.parts take their place.
"""

from __future__ import annotations

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

# Fields in the order of their numbers, from 1: "name" is a required double, "name:bool" a required bool, "name[]" doubles.
_FIELDS = {
    "CartesianImpedanceFeedbackControllerMessage": "translational_stiffnesses[] rotational_stiffnesses[]",
    "ForceAxisFeedbackControllerMessage": "translational_stiffness rotational_stiffness axis[]",
    "JointImpedanceFeedbackControllerMessage": "k_gains[] d_gains[]",
    "InternalImpedanceFeedbackControllerMessage": "cartesian_impedances[] joint_impedances[]",
    "ForcePositionFeedbackControllerMessage": (
        "position_kps_cart[] force_kps_cart[] position_kps_joint[] force_kps_joint[] selection[] use_cartesian_gains:bool"
    ),
    "JointTorqueFeedbackControllerMessage": "selection[] remove_gravity[] joint_torques[] k_gains[] d_gains[]",
    "GripperTrajectoryGeneratorMessage": "grasp:bool width speed force",
    "ImpulseTrajectoryGeneratorMessage": "run_time acc_time max_trans max_rot forces[] torques[]",
    "JointTrajectoryGeneratorMessage": "run_time joints[]",
    "JointVelocityTrajectoryGeneratorMessage": "run_time joint_velocities[] joint_accelerations[]",
    "CartesianVelocityTrajectoryGeneratorMessage": "run_time cartesian_velocities[] cartesian_accelerations[]",
    "PoseTrajectoryGeneratorMessage": "run_time position[] quaternion[] pose[]",
    "JointDMPTrajectoryGeneratorMessage": (
        "run_time tau alpha beta num_basis num_sensor_values basis_mean[] basis_std[] weights[] initial_sensor_values[]"
    ),
    "PoseDMPTrajectoryGeneratorMessage": (
        "orientation_only:bool position_only:bool ee_frame:bool run_time tau alpha beta num_basis num_sensor_values "
        "basis_mean[] basis_std[] weights[] initial_sensor_values[]"
    ),
    "QuaternionPoseDMPTrajectoryGeneratorMessage": (
        "ee_frame:bool run_time tau_pos alpha_pos beta_pos tau_quat alpha_quat beta_quat num_basis_pos num_sensor_values_pos "
        "num_basis_quat num_sensor_values_quat pos_basis_mean[] pos_basis_std[] pos_weights[] pos_initial_sensor_values[] "
        "quat_basis_mean[] quat_basis_std[] quat_weights[] quat_initial_sensor_values[] goal_time_quat goal_quat_w "
        "goal_quat_x goal_quat_y goal_quat_z"
    ),
    "RunTimeMessage": "run_time",
    "ContactTerminationHandlerMessage": "buffer_time force_thresholds[] torque_thresholds[]",
    "JointThresholdMessage": "buffer_time joint_thresholds[]",
    "PoseThresholdMessage": "buffer_time position_thresholds[] orientation_thresholds[]",
    "TimeTerminationHandlerMessage": "buffer_time",
}
_Field = descriptor_pb2.FieldDescriptorProto


def _file() -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(
        name="frankapy/proto/published_parameters.proto", package="frankapy.published", syntax="proto2"
    )
    for message, fields in _FIELDS.items():
        descriptor = file.message_type.add(name=message)
        for number, field in enumerate(fields.split(), 1):
            is_list, is_bool = field.endswith("[]"), field.endswith(":bool")
            descriptor.field.add(
                name=field.removesuffix("[]").removesuffix(":bool"),
                number=number,
                type=_Field.TYPE_BOOL if is_bool else _Field.TYPE_DOUBLE,
                label=_Field.LABEL_REPEATED if is_list else _Field.LABEL_REQUIRED,
            )
    return file


descriptor_pool.Default().AddSerializedFile(_file().SerializeToString())
_described = descriptor_pool.Default().FindFileByName("frankapy/proto/published_parameters.proto")
globals().update({name: message_factory.GetMessageClass(_described.message_types_by_name[name]) for name in _FIELDS})

__all__ = list(_FIELDS)  # noqa: PLE0605
