//! Prepares the text of a net before it is loaded: adds a head with its name and the names of its devices, and an input
//! that ends it. Also finds its communication keys. Pure functions.

use std::collections::{BTreeMap, BTreeSet};

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_directionet::text::{AstArgument, AstFragment, AstPrimitive, AstValue, parse};

/// Input that ends a net: a stop of the library is a regular end here, so that the arm plays its last set-points.
pub const STOP_INPUT: &str = "in_rccstop";
/// Longest text of a net in bytes; the longest that was seen has 105 kB.
pub const NET_MAX: usize = 2 << 20;

const STOP_KEY: &str = "_rccstop";
/// Names of the primitives that are added. The library numbers its own.
const ADDED_INPUT: &str = "rccstopinput";
const ADDED_END: &str = "rccstopend";

/// A net of the library, as it is loaded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NetText {
    /// The text with its head.
    pub text: String,
    /// Keys of the values that the net reports to the application, by the id of their `Monitor`: `out_2` is `out_2`,
    /// `outoverride` is `outOverride`.
    pub reported: BTreeMap<String, String>,
    /// Keys of the values that the application sets, by the id of their `Input`: `inoverride` is `inOverride`.
    pub inputs: BTreeMap<String, String>,
    /// Names of devices in the text.
    pub devices: BTreeSet<String>,
}

/// Why a text cannot be loaded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NetTextError {
    /// Not DirectIONet.
    #[error("Syntax error in net: {0}")]
    Syntax(String),
    /// Too long.
    #[error("the net has {0} bytes, at most {NET_MAX} are allowed")]
    TooLong(usize),
    /// A net that is loaded must have this output.
    #[error("the net has no output outTerminate that names a port")]
    NoTermination,
    /// A name that the head cannot carry.
    #[error("the name of the device '{0}' has a comma, an equals sign or a line break")]
    DeviceName(String),
    /// Two keys with one id.
    #[error("the keys '{0}' and '{1}' differ in case only")]
    SameKey(String, String),
}

/// The purpose of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NetUse {
    /// To be started and stopped.
    Run,
    /// To be evaluated for one cycle.
    Evaluate,
}

/// Prepares the text of a net with this name; `devices` are the names in the cell by those of the library.
///
/// # Errors
/// Returns what the text lacks.
pub fn prepare(
    given: &str,
    name: &str,
    devices: &BTreeMap<String, String>,
    purpose: NetUse,
) -> Result<NetText, NetTextError> {
    if given.len() > NET_MAX {
        return Err(NetTextError::TooLong(given.len()));
    }
    let (_, root) =
        parse(given).map_err(|diagnostic| NetTextError::Syntax(message(&diagnostic, given)))?;
    let mut found = NetText::default();
    collect(&root, &mut found)?;
    let body = match purpose {
        NetUse::Run => with_stop(given, &root)?,
        NetUse::Evaluate => with_end(given, &root),
    };
    let used: Vec<String> = found
        .devices
        .iter()
        .filter_map(|device| Some(format!("{device}={}", devices.get(device)?)))
        .collect();
    let unfit = found
        .devices
        .iter()
        .find(|device| device.contains([',', '=', '\n', '\r']));
    if let Some(device) = unfit {
        return Err(NetTextError::DeviceName(device.clone()));
    }
    let head = match used.is_empty() {
        true => String::new(),
        false => format!("# devices: {}\n", used.join(", ")),
    };
    found.text = format!("# net: {name}\n{head}{body}\n");
    Ok(found)
}

fn message(diagnostic: &Diagnostic, text: &str) -> String {
    let before = diagnostic.place.map_or(0, |place| place.start);
    let before = text.get(..before).unwrap_or_default();
    format!(
        "{} at character {}",
        diagnostic.message,
        before.chars().count() + 1
    )
}

/// Adds the input that ends the net to what ends it already.
fn with_stop(given: &str, root: &AstFragment) -> Result<String, NetTextError> {
    let item = root
        .items
        .iter()
        .find(|item| item.name.name == "outTerminate");
    let place = item.and_then(|item| match (&item.primitive, &item.port) {
        (AstPrimitive::Named(from), Some(port)) => Some(Span::new(from.span.start, port.span.end)),
        _ => None,
    });
    let place = place.ok_or(NetTextError::NoTermination)?;
    let part = |from: usize, to: usize| given.get(from..to).unwrap_or_default();
    let end = given.rfind('}').unwrap_or(given.len());
    let before = part(place.start, place.end);
    Ok(format!(
        "{}{ADDED_END}.outValue{},{ADDED_INPUT}=Core::BooleanNetcommIn(Key='{STOP_KEY}',Value='false'),\
         {ADDED_END}=Core::BooleanOr(inFirst={before},inSecond={ADDED_INPUT}.outValue,First='false',Second='false')}}",
        part(0, place.start),
        part(place.end, end),
    ))
}

/// Ends a net that is only evaluated, after its first cycle.
fn with_end(given: &str, root: &AstFragment) -> String {
    if root
        .items
        .iter()
        .any(|item| item.name.name == "outTerminate")
    {
        return given.to_owned();
    }
    let end = given.rfind('}').unwrap_or(given.len());
    let comma = if root.items.is_empty() { "" } else { "," };
    format!(
        "{}{comma}{ADDED_END}=Core::BooleanValue(Value='true'),outTerminate={ADDED_END}.outValue}}",
        given.get(..end).unwrap_or_default()
    )
}

fn collect(fragment: &AstFragment, found: &mut NetText) -> Result<(), NetTextError> {
    for item in &fragment.items {
        match &item.primitive {
            AstPrimitive::Named(_) => {}
            AstPrimitive::Typed(ty, arguments) => primitive(&ty.name, arguments, found)?,
            AstPrimitive::Fragment(inner, ..) => collect(inner, found)?,
        }
    }
    Ok(())
}

fn primitive(ty: &str, arguments: &[AstArgument], found: &mut NetText) -> Result<(), NetTextError> {
    let text = |wanted: &str| {
        arguments.iter().find_map(|argument| match &argument.value {
            AstValue::Text(text, _) if argument.name.name == wanted => Some(text.as_str()),
            _ => None,
        })
    };
    // The parameters that name a device, of all types.
    let devices = ["Robot", "robot", "Device", "DeviceID"]
        .into_iter()
        .filter_map(text);
    found.devices.extend(devices.map(str::to_owned));
    let Some(key) = text("Key") else {
        return Ok(());
    };
    // `InterNetcomm…` has `RemoteKey`.
    let (known, full) = match ty.strip_suffix("NetcommOut") {
        Some(_) if text("Report") == Some("false") => return Ok(()),
        Some(_) => (&mut found.reported, format!("out{key}")),
        None if ty.ends_with("NetcommIn") => (&mut found.inputs, format!("in{key}")),
        None => return Ok(()),
    };
    match known.insert(id_of(&full), full.clone()) {
        Some(other) if other != full => Err(NetTextError::SameKey(other, full)),
        _ => Ok(()),
    }
}

/// Converts a key to an id, as the reader of DirectIONet does.
fn id_of(key: &str) -> String {
    let letters = key.chars().map(|character| match character {
        'a'..='z' | '0'..='9' | '_' => character,
        'A'..='Z' => character.to_ascii_lowercase(),
        _ => '_',
    });
    letters.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NET: &str = "{1=Core::BooleanNetcommOut(inValue=3.outValue,Key='_1',Value='false'),\
        2=Core::DoubleNetcommIn(Key='Override',Value='1.0'),3=Core::BooleanValue(Value='false'),\
        f={4=Core::DoubleNetcommOut(inValue=parent.inX,Key='Error'),5=World::FrameNetcommOut(Key='x',Report='false'),\
        6=RobotArm::JointMonitor(Robot='my arm',Axis='0')}(inX=2.outValue),outTerminate=3.outValue}";

    #[test]
    fn a_net_gets_a_head_and_an_input_that_ends_it() {
        let devices = BTreeMap::from([("my arm".to_owned(), "d1".to_owned())]);
        let net = prepare(NET, "rpinet1", &devices, NetUse::Run).expect("a net");
        assert!(
            net.text
                .starts_with("# net: rpinet1\n# devices: my arm=d1\n{1="),
            "{}",
            net.text
        );
        assert!(
            net.text
                .contains("outTerminate=rccstopend.outValue,rccstopinput="),
            "{}",
            net.text
        );
        assert!(
            net.text
                .contains("inFirst=3.outValue,inSecond=rccstopinput"),
            "{}",
            net.text
        );
        assert!(parse(&net.text).is_ok(), "{}", net.text);
    }

    #[test]
    fn keys_are_found_in_fragments_and_keep_their_case() {
        let net = prepare(NET, "a", &BTreeMap::new(), NetUse::Run).expect("a net");
        let reported: Vec<_> = net
            .reported
            .iter()
            .map(|(id, key)| (&**id, &**key))
            .collect();
        assert_eq!(reported, [("out_1", "out_1"), ("outerror", "outError")]);
        assert_eq!(net.inputs["inoverride"], "inOverride");
        assert_eq!(
            net.inputs.len(),
            1,
            "the added input is not the application's"
        );
        assert_eq!(net.devices, BTreeSet::from(["my arm".to_owned()]));
    }

    #[test]
    fn an_evaluated_net_ends_by_itself() {
        for text in ["{a=Core::DoubleNetcommOut(Key='r',Value='1')}", "{}"] {
            let net = prepare(text, "e", &BTreeMap::new(), NetUse::Evaluate).expect("a net");
            assert!(
                net.text.contains("outTerminate=rccstopend.outValue}"),
                "{}",
                net.text
            );
            assert!(parse(&net.text).is_ok(), "{}", net.text);
        }
    }

    #[test]
    fn what_cannot_be_loaded_is_refused_in_words() {
        let refused = |text: &str| {
            prepare(text, "a", &BTreeMap::new(), NetUse::Run)
                .expect_err(text)
                .to_string()
        };
        assert!(
            refused("{1=").starts_with("Syntax error in net: "),
            "{}",
            refused("{1=")
        );
        assert!(refused("{}").contains("outTerminate"));
        assert!(refused("{a=X(Robot='a,b'),outTerminate=a.outX}").contains("comma"));
        let same =
            "{a=Core::IntNetcommIn(Key='a'),b=Core::IntNetcommIn(Key='A'),outTerminate=a.outX}";
        assert!(refused(same).contains("case"), "{}", refused(same));
        assert!(matches!(
            prepare(&" ".repeat(NET_MAX + 1), "a", &BTreeMap::new(), NetUse::Run),
            Err(NetTextError::TooLong(_))
        ));
    }
}
