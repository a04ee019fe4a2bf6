//! `devices`: the devices of the cell, and why one is not ready.

use rcc_loader::server::api::DeviceView;

use crate::context::Context;
use crate::failure::Failure;
use crate::table;

/// Nothing more to say.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// The channels of each device, too.
    #[arg(long)]
    channels: bool,
}

/// Does it.
///
/// # Errors
/// Not reachable.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let devices: Vec<DeviceView> = context.client()?.get("/devices")?;
    context.print(&devices, |devices| list(devices, arguments.channels));
    Ok(())
}

fn list(devices: &[DeviceView], channels: bool) -> String {
    let heads = ["DEVICE", "DRIVER", "STATE", "QUALITY", "LOSSES", "HELD BY", "REASON"];
    let mut rows = table::table(&heads);
    for device in devices {
        rows.add_row([
            device.name.clone(),
            device.driver.clone(),
            device.state.clone(),
            format!("{:.1} %", f64::from(device.quality_permille) / 10.0),
            device.losses.to_string(),
            device.holder.clone().unwrap_or_else(|| "–".to_owned()),
            device.reason.clone(),
        ]);
    }
    let mut text = table::text(&rows);
    if channels {
        let mut rows = table::table(&["CHANNEL", "KIND", "UNIT", "ON RELEASE"]);
        for device in devices {
            for channel in &device.channels {
                rows.add_row([
                    format!("{}.{}", device.name, channel.name),
                    channel.kind.clone(),
                    channel.unit.clone(),
                    channel.on_release.clone().unwrap_or_default(),
                ]);
            }
        }
        text = format!("{text}\n\n{}", table::text(&rows));
    }
    text
}
