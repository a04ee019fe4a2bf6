// Measures Orocos KDL with a chain as its robot-description parser builds it. Built and run by `bench/kinematics/compare`.
#include <kdl/chain.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>
#include <kdl/chainiksolvervel_wdls.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <kdl/config.h>
#include <kdl/frames.hpp>

#include "program.hpp"

using KDL::Frame, KDL::JntArray, KDL::Vector;

static KDL::Chain chain_of(const Chain &described) {
    KDL::Chain chain;
    for (const Axis &a : described.axes) {
        const KDL::Joint joint("", Vector(a.origin[0], a.origin[1], a.origin[2]), Vector(a.axis[0], a.axis[1], a.axis[2]),
                               KDL::Joint::RotAxis, a.sign, a.zero);
        const bool last = &a == &described.axes.back();
        const Frame tip(last ? Vector(described.tip[0], described.tip[1], described.tip[2]) : Vector::Zero());
        chain.addSegment(KDL::Segment(joint, joint.pose(0) * tip));
    }
    return chain;
}

static std::vector<JntArray> arrays(const std::vector<std::vector<double>> &all) {
    std::vector<JntArray> arrays;
    for (const auto &one : all) {
        JntArray array(one.size());
        for (std::size_t k = 0; k < one.size(); ++k) array(k) = one[k];
        arrays.push_back(array);
    }
    return arrays;
}

int main(int, char **arguments) {
    const Chain described = read_chain(arguments[1]);
    const unsigned joints = described.axes.size();
    const KDL::Chain chain = chain_of(described);
    const auto configurations = read_configurations(arguments[2], joints);
    const std::vector<JntArray> at = arrays(configurations);
    const std::size_t count = at.size();
    KDL::ChainFkSolverPos_recursive forward(chain);
    KDL::ChainJntToJacSolver differential(chain);
    std::vector<Frame> poses(count);
    std::ofstream file(arguments[3]);
    file << std::setprecision(17);
    for (std::size_t k = 0; k < count; ++k) {
        KDL::Jacobian jacobian(joints);
        forward.JntToCart(at[k], poses[k]);
        differential.JntToJac(at[k], jacobian);
        for (int i = 0; i < 3; ++i) file << poses[k].p(i) << ' ';
        for (int i = 0; i < 9; ++i) file << poses[k].M(i / 3, i % 3) << ' ';
        for (unsigned i = 0; i < 6 * joints; ++i) file << jacobian(i / joints, i % joints) << ' ';
        file << '\n';
    }

    std::map<std::string, double> figures;
    Frame pose;
    KDL::Jacobian jacobian(joints);
    figures["forward"] = measure(count, 100, [&](std::size_t k) { forward.JntToCart(at[k], pose), keep(pose); });
    figures["jacobian"] = measure(count, 100, [&](std::size_t k) { differential.JntToJac(at[k], jacobian), keep(jacobian); });
    KDL::ChainIkSolverVel_wdls velocity(chain);
    velocity.setLambda(0.05);
    const KDL::Twist twist(Vector(0.1, 0.05, -0.02), Vector(0.1, 0.0, 0.2));
    JntArray found(joints);
    figures["velocity"] = measure(count, 20, [&](std::size_t k) { velocity.CartToJnt(at[k], twist, found), keep(found); });

    // Levenberg-Marquardt, its most reliable solver, with its default tolerance.
    KDL::ChainIkSolverPos_LMA inverse(chain);
    for (const auto &[name, by_rad] : {std::pair("inverse", 0.3), std::pair("inverse_near", 0.002)}) {
        const std::vector<JntArray> seeds = arrays(beside(configurations, by_rad));
        double solved = 0, worst = 0;
        for (std::size_t k = 0; k < count; ++k) {
            if (inverse.CartToJnt(seeds[k], poses[k], found) < 0) continue;
            forward.JntToCart(found, pose);
            worst = std::max(worst, (pose.p - poses[k].p).Norm());
            solved += 1;
        }
        figures[std::string(name) + "_solved"] = solved / count;
        figures[std::string(name) + "_worst_m"] = worst;
        figures[name] = measure(count, 3, [&](std::size_t k) { inverse.CartToJnt(seeds[k], poses[k], found), keep(found); });
    }
    print(KDL_VERSION_STRING, figures);
}
