// Measures pinocchio with a model as its robot-description parser builds it. It has no inverse kinematics of position. Built
// and run by `bench/kinematics/compare`, against the headers of the PyPI package `pin`.
#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/utils/version.hpp>

#include "program.hpp"

namespace pin = pinocchio;
using Vector3 = Eigen::Vector3d;

static Vector3 vector(const std::array<double, 3> &v) { return Vector3(v[0], v[1], v[2]); }

static pin::JointModel joint_about(const Vector3 &axis) {
    if (axis == Vector3::UnitX()) return pin::JointModelRX();
    if (axis == Vector3::UnitY()) return pin::JointModelRY();
    if (axis == Vector3::UnitZ()) return pin::JointModelRZ();
    return pin::JointModelRevoluteUnaligned(axis);
}

int main(int, char **arguments) {
    const Chain described = read_chain(arguments[1]);
    const auto joints = long(described.axes.size());
    pin::Model model;
    pin::JointIndex last = 0;
    for (const Axis &a : described.axes) {
        const Vector3 axis = vector(a.axis);
        const Eigen::Matrix3d turned = Eigen::AngleAxisd(a.zero, axis).toRotationMatrix();
        last = model.addJoint(last, joint_about(a.sign * axis), pin::SE3(turned, vector(a.origin)), "joint" + std::to_string(last));
    }
    const pin::SE3 tip(Eigen::Matrix3d::Identity(), vector(described.tip));
    const pin::FrameIndex flange = model.addFrame(pin::Frame("flange", last, 0, tip, pin::OP_FRAME));
    pin::Data data(model);

    std::vector<Eigen::VectorXd> at;
    for (const auto &one : read_configurations(arguments[2], joints))
        at.push_back(Eigen::Map<const Eigen::VectorXd>(one.data(), joints));
    pin::Data::Matrix6x jacobian = pin::Data::Matrix6x::Zero(6, joints);
    const auto forward = [&](std::size_t k) {
        pin::forwardKinematics(model, data, at[k]);
        keep(pin::updateFramePlacement(model, data, flange));
    };
    const auto differential = [&](std::size_t k) {
        pin::computeJointJacobians(model, data, at[k]);
        pin::updateFramePlacement(model, data, flange);
        pin::getFrameJacobian(model, data, flange, pin::LOCAL_WORLD_ALIGNED, jacobian);
        keep(jacobian);
    };
    std::ofstream file(arguments[3]);
    file << std::setprecision(17);
    for (std::size_t k = 0; k < at.size(); ++k) {
        differential(k);
        const pin::SE3 &pose = data.oMf[flange];
        for (int i = 0; i < 3; ++i) file << pose.translation()(i) << ' ';
        for (int i = 0; i < 9; ++i) file << pose.rotation()(i / 3, i % 3) << ' ';
        for (long i = 0; i < 6 * joints; ++i) file << jacobian(i / joints, i % joints) << ' ';
        file << '\n';
    }
    std::map<std::string, double> figures;
    figures["forward"] = measure(at.size(), 100, forward);
    figures["jacobian"] = measure(at.size(), 100, differential);
    print(pin::printVersion(), figures);
}
