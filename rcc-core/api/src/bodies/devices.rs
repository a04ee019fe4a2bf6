//! Bodies about devices and their channels.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

/// A device.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct DeviceView {
    /// Its name.
    pub name: String,
    /// Its driver's name.
    pub driver: String,
    /// `offline online ready commanded stopping`, as the executor sees it.
    pub state: String,
    /// Why it is not ready, in the driver's words; empty if it is fine.
    #[serde(default)]
    pub reason: String,
    /// The net that holds it, as `net#id`.
    #[serde(default)]
    pub holder: Option<String>,
    /// Quality of the connection in thousandths, 1000 is best.
    pub quality_permille: u32,
    /// Number of times that the executor lost the device.
    pub losses: u64,
    /// Process id of the driver; 0 if there is none.
    pub pid: u32,
    /// Names of its joints.
    pub joints: Vec<String>,
    /// Its channels.
    pub channels: Vec<ChannelView>,
}

/// A channel of a device.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct ChannelView {
    /// Its name.
    pub name: String,
    /// `digital input`, `digital output`, `analog input`, `analog output`.
    pub kind: String,
    /// Its unit.
    pub unit: String,
    /// For an output: its value when nobody commands it.
    #[serde(default)]
    pub on_release: Option<String>,
}
