//! Conformance of the gateway `rcc-robotics-api` to the protocol of the Java Robotics API v2, seen by a client that
//! behaves on the wire as the library does. Run by the threads of the test harness.

mod client;
mod gateway;
mod life;
mod motions;
mod nets;
mod wire;
