//! `convert FILE`: converts a net between DirectIONet (the predecessor's format), YAML and JSON. Needs no cell.

use std::path::PathBuf;

use rcc_api::codes;
use rcc_api::compile::findings;
use rcc_directionet::{NOTATION, compiler};
use rcc_language::devices::DeviceTable;
use rcc_language::parse::parse;
use rcc_language::{Faults, formula, write};

use crate::context::Context;
use crate::failure::{Failure, draw};
use crate::follow::read_text;
use crate::output::{print_diagnostics, print_note};
use crate::result_file::ResultTarget;
use crate::scenario::{DevicesOf, config_or_demo, load_config};
use smooth::smooth;

mod smooth;

/// Arguments of `convert`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Net in DirectIONet, YAML or JSON; - reads standard input
    file: String,
    /// Output format
    #[arg(long, value_enum, default_value = "yaml")]
    to: NetFormat,
    #[command(flatten)]
    target: ResultTarget,
    /// Cell configuration whose devices the net uses [default: the demo cell's]
    #[arg(long)]
    config: Option<PathBuf>,
    /// Map a device name in the text to one of the cell
    #[arg(long = "device", value_name = "THEIRS=OURS")]
    devices: Vec<String>,
    /// Map a channel in the text to one of the cell: io.InBool.8=door_closed
    #[arg(long = "channel", value_name = "DEVICE.TYPE.PORT=NAME")]
    channels: Vec<String>,
    /// Insert a low-pass filter before each joint set-point, and end the net when it has settled: steps in acceleration,
    /// which profiles of the predecessor have, then keep the limits of jerk
    #[arg(
        long,
        value_name = "CUTOFF",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = smooth::CUTOFF_HZ,
        value_parser = smooth::cutoff
    )]
    smooth: Option<f64>,
    /// Output to the application that ends the net when it becomes true
    #[arg(long, value_name = "KEY")]
    end: Vec<String>,
}

/// Formats of nets.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
enum NetFormat {
    /// RCC's format, for people
    Yaml,
    /// RCC's format, for programs
    Json,
    /// The predecessor's format
    Directionet,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the net is invalid or cannot be expressed in the other format.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let config = load_config(&config_or_demo(arguments.config.as_deref())?)?;
    let cell = DeviceTable::from(&config);
    let (name, text) = read_text(&arguments.file)?;
    let text = header(&arguments)? + &text;
    let invalid = |faults: &_| Failure::from_faults("invalid net", faults);
    let compiled = compiler(&cell).compile(&text, &name).map_err(|faults| {
        DevicesOf::option(arguments.config.as_deref()).note(&findings(&faults));
        invalid(&faults)
    })?;
    let mut faults = Vec::new();
    let mut net = parse(&text, &name, &cell, &[NOTATION], &mut faults);
    if let (Some(net), Some(cutoff_hz)) = (&mut net, arguments.smooth) {
        if arguments.to == NetFormat::Directionet {
            return Err(Failure::new(
                codes::BAD_REQUEST,
                "--smooth is for nets of RCC, and the predecessor needs no filter",
                "omit --smooth, or convert to yaml or json",
            ));
        }
        let done = smooth(net, cutoff_hz)?;
        print_note(&format!(
            "{} low-pass filters of {cutoff_hz} Hz inserted; the net ends {} s later, and a path is kept less exactly",
            done.filters, done.settling_s
        ));
    }
    let converted = net.and_then(|net| match arguments.to {
        NetFormat::Yaml => Some(write::yaml(&net)),
        NetFormat::Json => Some(write::json(&net)),
        NetFormat::Directionet => {
            let mut net = net;
            formula::lower_alone(&mut net, &text, &name, &mut faults);
            rcc_directionet::write::text(&net, &compiled.names, &cell, &mut faults)
        }
    });
    // A text that compiles can be read, so only writing can have failed.
    let Some(converted) = converted else {
        return Err(invalid(&Faults::new(name, text, faults)));
    };
    let warnings = findings(&compiled.warnings);
    print_diagnostics(&draw(&warnings, Some(&(name, text)), Context::drawing()));
    arguments.target.write(context, &converted)
}

/// Returns the header lines that correspond to the command line's options.
fn header(arguments: &Arguments) -> Result<String, Failure> {
    let mut header = String::new();
    for (key, values) in [
        ("devices", &arguments.devices),
        ("channels", &arguments.channels),
        ("end", &arguments.end),
    ] {
        if let Some(bad) = values.iter().find(|value| value.contains('\n')) {
            let message = format!("`{bad}` spans more than one line");
            return Err(Failure::new(
                codes::BAD_REQUEST,
                message,
                "pass names without line breaks",
            ));
        }
        if !values.is_empty() {
            header += &format!("# {key}: {}\n", values.join(", "));
        }
    }
    Ok(header)
}
