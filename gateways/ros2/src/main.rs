//! `rcc-ros2`: the gateway for ROS 2. The main thread waits for signals; one thread reads the cell, one looks at its nets, one
//! spins the node, and one for each operation serves requests.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{Parser, ValueEnum};
use rcc_process::Stop;
use rcc_process::oom::{SCORE_OBSERVER, raise_score};
use rcc_ros2::cell::{self, ArmStates, CellOptions};
use rcc_ros2::names::is_node;
use rcc_ros2::nets::{self, NetsOptions};
use rcc_ros2::node::{NodeError, NodePlace, RosNode};
use rcc_ros2::parameters::Parameters;
use rcc_ros2::services::{Operation, OperationServers};
use rcc_ros2::trajectory::server::TrajectoryServers;
use ros2_client::ServiceMapping;

/// Presents a cell to ROS 2: joint states, frames, topics and services of its nets, FollowJointTrajectory.
#[derive(Parser)]
#[command(name = "rcc-ros2", version = rcc_protocol::version::version())]
struct Arguments {
    /// Name of the cell; it need not run yet
    #[arg(long, env = "RCC_CELL", default_value = "demo")]
    cell: String,
    /// Name of the node, the first part of the names of topics and services of nets [default: the cell's, with `_` for `-`]
    #[arg(long, value_name = "NAME", value_parser = node_name)]
    node: Option<String>,
    /// DDS domain
    #[arg(long, env = "ROS_DOMAIN_ID", default_value = "0", value_parser = clap::value_parser!(u16).range(0..=232))]
    domain: u16,
    /// Announce the node on the loopback interface only; no protection, since its ports are open on all interfaces
    #[arg(long)]
    localhost_only: bool,
    /// DDS implementation of the peers (their RMW_IMPLEMENTATION): it decides how services are carried
    #[arg(long, value_enum, default_value = "fastrtps")]
    rmw: Rmw,
    /// Let every node of the domain start nets, set their Inputs and send trajectories; CANCEL of nets is always offered
    #[arg(long)]
    control: bool,
    /// Greatest rate of the messages about an arm, and of each topic of a net, Hz
    #[arg(long, default_value = "100", value_parser = rate)]
    rate: f64,
    /// End with the process that started this one
    #[arg(long)]
    parent_death: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Rmw {
    /// rmw_fastrtps_cpp, the default of ROS
    Fastrtps,
    /// rmw_cyclonedds_cpp
    Cyclonedds,
}

/// The reason why nothing is presented.
#[derive(Debug, thiserror::Error)]
enum GatewayError {
    #[error(transparent)]
    Node(#[from] NodeError),
    #[error("cannot start: {0}")]
    Signals(#[from] rcc_process::signals::SignalError),
    #[error("cannot start: {0}")]
    System(#[from] std::io::Error),
}

fn main() -> ExitCode {
    rcc_process::begin();
    let arguments = Arguments::parse();
    // If memory runs out, the kernel should first end processes that only observe.
    let _ = raise_score(SCORE_OBSERVER);
    match run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            rcc_process::remark(&format!("rcc-ros2: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: Arguments) -> Result<(), GatewayError> {
    // Before the first thread, which inherits the mask.
    let stop = Stop::prepare(arguments.parent_death)?;
    let cell = arguments.cell;
    let parameters = Parameters::default();
    let place = NodePlace {
        name: arguments
            .node
            .unwrap_or_else(|| rcc_recording::table::field_name(&cell)),
        domain: arguments.domain,
        localhost_only: arguments.localhost_only,
        mapping: match arguments.rmw {
            Rmw::Fastrtps => ServiceMapping::Enhanced,
            Rmw::Cyclonedds => ServiceMapping::Cyclone,
        },
    };
    let options = parameters.options(&cell, arguments.control);
    let (node, spinner) = RosNode::join(&place, options)?;
    let spun = std::thread::Builder::new()
        .name("spinner".to_owned())
        .spawn(move || {
            if let Err(error) = futures::executor::block_on(spinner.spin()) {
                tracing::error!(?error, "discovery and parameters are not served any more");
            }
        })?;
    let ends = Arc::new(AtomicBool::new(false));
    let offered: &[Operation] = match arguments.control {
        true => &[Operation::Start, Operation::Cancel],
        false => &[Operation::Cancel],
    };
    let (mut services, mut wakers) = (Vec::new(), Vec::new());
    for operation in offered {
        let (servers, waker) = OperationServers::start(*operation, &cell, &ends)?;
        services.push(servers);
        wakers.push(waker);
    }
    let states = Arc::new(ArmStates::default());
    let trajectories = match arguments.control {
        true => {
            let (servers, waker) = TrajectoryServers::start(&cell, &states, &ends)?;
            wakers.push(waker);
            Some(servers)
        }
        false => None,
    };
    let reader = {
        let options = CellOptions {
            cell: cell.clone(),
            rate_hz: arguments.rate,
        };
        let (node, states, ends) = (Arc::clone(&node), Arc::clone(&states), Arc::clone(&ends));
        let reader = std::thread::Builder::new().name("cell".to_owned());
        reader.spawn(move || cell::run(&options, node, &states, &ends))?
    };
    let looker = {
        let options = NetsOptions {
            cell,
            rate_hz: arguments.rate,
            services,
            parameters,
            trajectories,
        };
        let (node, ends) = (Arc::clone(&node), Arc::clone(&ends));
        let looker = std::thread::Builder::new().name("nets".to_owned());
        looker.spawn(move || nets::run(options, node, &ends))?
    };
    rcc_process::say(&format!("node /{} in domain {}", place.name, place.domain));
    let signal = stop.wait();
    tracing::info!(%signal, "ends");
    ends.store(true, Ordering::Release);
    for waker in wakers {
        // A thread that cannot be woken ends with the process.
        let _ = waker.wake();
    }
    // Shared memory is given back before the process ends. An error means that the thread panicked, and said so.
    let _ = (reader.join(), looker.join());
    node.lock().stop_spinner();
    let _ = spun.join();
    Ok(())
}

fn node_name(text: &str) -> Result<String, String> {
    match is_node(text) {
        true => Ok(text.to_owned()),
        false => Err("write letters, digits and single `_`, beginning with a letter".to_owned()),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    let rate = text.trim().parse::<f64>().ok();
    rate.filter(|rate| (0.1..=1000.0).contains(rate))
        .ok_or_else(|| format!("invalid rate `{text}`: write a number from 0.1 to 1000, in Hz"))
}
