//! Instances of fragments. Until they are expanded, a net that has any is refused. The loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_config::yaml::Key;

use crate::fault;
use crate::syntax::{Kind, Net};

/// Reports every use of a fragment, of a library and of a condition.
pub fn refuse(net: &Net, faults: &mut Vec<Diagnostic>) {
    let mut refuse = |key: &Key, what: &str| {
        let message = format!("`{}`: {what} are read, but not yet evaluated", key.name);
        faults.push(Diagnostic::error(fault::NOT_SUPPORTED, key.span, message));
    };
    for library in &net.uses {
        refuse(library, "libraries");
    }
    for fragment in &net.fragments {
        refuse(&fragment.name, "fragments");
    }
    for primitive in &net.primitives {
        if primitive.kind == Kind::Fragment {
            refuse(&primitive.id, "instances of fragments");
        } else if primitive.active.is_some() {
            refuse(&primitive.id, "conditions (`active`)");
        }
    }
}
