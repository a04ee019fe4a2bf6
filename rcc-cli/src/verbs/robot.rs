//! `robot import FILE.urdf`: creates a robot file from a URDF, with closed-form inverse kinematics if its chain has one.
//! Needs no cell.

use std::path::{Path, PathBuf};

use rcc_api::codes;

use crate::context::Context;
use crate::failure::Failure;
use crate::output::print_note;
use crate::result_file::ResultTarget;

/// Arguments of `robot`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    #[command(subcommand)]
    what: RobotCommand,
}

#[derive(clap::Subcommand, Debug)]
enum RobotCommand {
    /// Create a robot file from a URDF; recognises the kind of arm and verifies it first
    Import(ImportArguments),
}

#[derive(clap::Args, Debug)]
struct ImportArguments {
    /// URDF file; expand xacro files with `xacro` first
    file: PathBuf,
    /// Base link [default: the root]
    #[arg(long)]
    base: Option<String>,
    /// Flange link [default: the only leaf, or tool0, flange, ee_link, ee]
    #[arg(long)]
    tip: Option<String>,
    #[command(flatten)]
    target: ResultTarget,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the file is not a URDF, or if its chain is not an arm; names the joint that does not fit.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let RobotCommand::Import(import) = arguments.what;
    let shown = import.file.display().to_string();
    let text = rcc_os::file::read_given(&import.file, rcc_robot::BYTES_MAX as u64)
        .map_err(|error| Failure::unreadable(&shown, &error))?;
    let imported = rcc_robot::import(&text, import.base.as_deref(), import.tip.as_deref());
    let imported = imported.map_err(|error| {
        let help =
            "name the arm's links with --base and --tip; see docs/robots.md for the supported arms";
        Failure::new(codes::BAD_REQUEST, format!("{shown}: {error}"), help)
    })?;
    let name = Path::new(&import.file).file_name();
    let name = name.map_or(shown.clone(), |name| name.to_string_lossy().into_owned());
    if let Some(reason) = &imported.not_closed {
        print_note(&format!(
            "numeric inverse kinematics (type: serial), because no closed form fits: {reason}"
        ));
    }
    let yaml = rcc_robot::yaml(&imported, &name);
    import.target.write(context, &yaml)
}
