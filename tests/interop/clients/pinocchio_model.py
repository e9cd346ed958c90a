"""The greatest differences between Pinocchio and samples of another model: `pinocchio_model.py URDF`, JSON in and out."""

import json
import sys

import numpy as np
import pinocchio

GRAVITY = 9.81  # m/s²
JOINTS = 7


def matrix(values) -> np.ndarray:
    """From column-major (16,)"""
    return np.array(values).reshape(4, 4).T


arm = pinocchio.buildModelFromUrdf(sys.argv[1])
arm.gravity.linear = np.array([0, 0, -GRAVITY])
(flange,) = (frame for frame in arm.frames if frame.name.endswith("link8"))
worst: dict[str, float] = {}


def compare(name: str, values, expected: np.ndarray) -> None:
    """`values` are column-major."""
    difference = np.abs(np.array(values) - expected.flatten("F")).max()
    worst[name] = max(worst.get(name, 0.0), float(difference))


for sample in json.load(sys.stdin):
    q, dq = np.array(sample["q"]), np.array(sample["dq"])
    tool = pinocchio.Inertia(
        sample["m_total"], np.array(sample["F_x_Ctotal"]), np.array(sample["I_total"]).reshape(3, 3)
    )
    loaded = arm.copy()
    loaded.inertias[JOINTS] += flange.placement.act(tool)
    data = loaded.createData()
    pinocchio.computeJointJacobians(loaded, data, q)
    pinocchio.updateFramePlacements(loaded, data)
    ends = {f"Joint{i}": (i, pinocchio.SE3.Identity()) for i in range(1, JOINTS + 1)}
    F_T_EE = pinocchio.SE3(matrix(sample["F_T_EE"]))
    EE_T_K = pinocchio.SE3(matrix(sample["EE_T_K"]))
    ends["Flange"] = (JOINTS, flange.placement)
    ends["EndEffector"] = (JOINTS, flange.placement * F_T_EE)
    ends["Stiffness"] = (JOINTS, flange.placement * F_T_EE * EE_T_K)
    for name, (joint, J_T_frame) in ends.items():
        O_T_frame = data.oMi[joint] * J_T_frame
        local = J_T_frame.toActionMatrixInverse() @ pinocchio.getJointJacobian(
            loaded, data, joint, pinocchio.ReferenceFrame.LOCAL
        )
        turned = np.kron(np.eye(2), O_T_frame.rotation) @ local
        for function, expected in (("pose", O_T_frame.homogeneous), ("body_jacobian", local), ("zero_jacobian", turned)):
            if name in sample.get(function, {}):
                compare(function, sample[function][name], expected)
    M = pinocchio.crba(loaded, data, q)
    compare("mass", sample["mass"], np.triu(M) + np.triu(M, 1).T)
    compare("gravity", sample["gravity"], pinocchio.computeGeneralizedGravity(loaded, data, q))
    pinocchio.computeCoriolisMatrix(loaded, data, q, dq)
    compare("coriolis", sample["coriolis"], data.C @ dq)
json.dump(worst, sys.stdout)
