//! Reads links and joints of a URDF text, with the defaults of URDF 1.0 to 1.2; other elements are ignored. The text
//! may come from anywhere: size, depth and attributes are bounded before parsing. Runs once per import.

mod bounds;

use nalgebra::{Isometry3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

pub use bounds::{ATTRIBUTES_MAX, BYTES_MAX, DEPTH_MAX};

/// Largest number of nodes (elements, texts, comments).
const NODES_MAX: u32 = 500_000;

/// Reason why a text is not a URDF.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UrdfError {
    /// The text is too long.
    #[error("it has {size} bytes; at most {BYTES_MAX} are allowed")]
    TooLarge {
        /// Length, bytes.
        size: usize,
    },
    /// Elements are nested too deep.
    #[error("line {line}: elements are nested more than {DEPTH_MAX} deep")]
    TooDeep {
        /// Line of the element.
        line: usize,
    },
    /// An element has too many attributes.
    #[error("line {line}: an element has more than {ATTRIBUTES_MAX} attributes")]
    TooManyAttributes {
        /// Line of the element.
        line: usize,
    },
    /// The text is not XML.
    #[error("{0}")]
    NotXml(#[from] roxmltree::Error),
    /// Another XML format.
    #[error("the root element is `{root}`; a URDF starts with `<robot name=…>`")]
    NotRobot {
        /// Name of the root element.
        root: String,
    },
    /// A required element or attribute is missing.
    #[error("line {line}: `{element}` has no `{what}`")]
    Missing {
        /// Line of the element.
        line: u32,
        /// Name of the element.
        element: String,
        /// Missing element or attribute.
        what: &'static str,
    },
    /// An attribute has an invalid value.
    #[error("line {line}: {attribute}=\"{value}\" is not {what}")]
    Malformed {
        /// Line of the element.
        line: u32,
        /// Name of the attribute.
        attribute: &'static str,
        /// Value, truncated if long.
        value: String,
        /// Required form.
        what: &'static str,
    },
}

/// A robot.
#[derive(Clone, Debug)]
pub(crate) struct UrdfRobot {
    pub name: String,
    pub links: Vec<String>,
    pub joints: Vec<UrdfJoint>,
}

/// A joint as given in the URDF.
#[derive(Clone, Debug)]
pub(crate) struct UrdfJoint {
    pub name: String,
    pub kind: JointKind,
    pub parent: String,
    pub child: String,
    /// Transformation from the parent's frame to the joint's frame, with the joint at 0.
    pub origin: Isometry3<f64>,
    pub axis: [f64; 3],
    /// `[lower, upper]`, rad; `[0, 0]` for a continuous joint, whose bounds URDF ignores.
    pub range: [f64; 2],
    /// Largest speed, rad/s; 0 if it is not given or unlimited.
    pub velocity: f64,
    /// Joint that this one mimics.
    pub mimic: Option<String>,
    /// `[soft_lower_limit, soft_upper_limit]`, rad.
    pub soft: Option<[f64; 2]>,
}

/// Type of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum JointKind {
    Fixed,
    Revolute,
    Continuous,
    /// Not revolute; the type as written.
    Other(&'static str),
}

const KINDS: [(&str, JointKind); 7] = [
    ("fixed", JointKind::Fixed),
    ("revolute", JointKind::Revolute),
    ("continuous", JointKind::Continuous),
    ("prismatic", JointKind::Other("prismatic")),
    ("floating", JointKind::Other("floating")),
    ("planar", JointKind::Other("planar")),
    ("spherical", JointKind::Other("spherical")),
];

/// Parses a URDF text.
pub(crate) fn read(text: &str) -> Result<UrdfRobot, UrdfError> {
    bounds::check(text)?;
    let options = ParsingOptions {
        allow_dtd: false,
        nodes_limit: NODES_MAX,
        ..ParsingOptions::default()
    };
    let document = Document::parse_with_options(text, options)?;
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        let root = shortened(root.tag_name().name());
        return Err(UrdfError::NotRobot { root });
    }
    let version = root.attribute("version").and_then(|version| {
        let (major, minor) = version.trim().split_once('.')?;
        Some((major.parse().ok()?, minor.parse().ok()?))
    });
    let version: (u32, u32) = version.unwrap_or((1, 0));
    let (mut links, mut joints) = (Vec::new(), Vec::new());
    for child in root.children().filter(Node::is_element) {
        match child.tag_name().name() {
            "link" => links.push(required(child, "name")?.to_owned()),
            "joint" => joints.push(joint(child, version)?),
            _ => {}
        }
    }
    Ok(UrdfRobot {
        name: required(root, "name")?.to_owned(),
        links,
        joints,
    })
}

fn joint(node: Node<'_, '_>, version: (u32, u32)) -> Result<UrdfJoint, UrdfError> {
    let written = required(node, "type")?;
    let kind = KINDS.iter().find(|(name, _)| *name == written.trim());
    let Some((_, kind)) = kind else {
        let what =
            "a joint type: fixed, revolute, continuous, prismatic, floating, planar or spherical";
        return Err(malformed(node, "type", written, what));
    };
    let link = |what: &'static str| match element(node, what) {
        Some(named) => required(named, "link").map(str::to_owned),
        None => Err(missing(node, what)),
    };
    let number = |of: Option<Node<'_, '_>>, name: &'static str, without: f64| {
        of.map_or(Ok(without), |of| scalar(of, name, without))
    };
    let limit = element(node, "limit");
    // From version 1.2 on, a missing bound is unlimited; before, it is 0.
    let endless = limit.is_some() && version >= (1, 2);
    let bound = |value: f64| if endless { value } else { 0.0 };
    let soft = element(node, "safety_controller");
    let soft = soft.map(|soft| -> Result<[f64; 2], UrdfError> {
        Ok([
            scalar(soft, "soft_lower_limit", 0.0)?,
            scalar(soft, "soft_upper_limit", 0.0)?,
        ])
    });
    let mimic = element(node, "mimic").map(|mimic| required(mimic, "joint").map(str::to_owned));
    Ok(UrdfJoint {
        name: required(node, "name")?.to_owned(),
        kind: *kind,
        parent: link("parent")?,
        child: link("child")?,
        origin: element(node, "origin")
            .map_or(Ok(Isometry3::identity()), |at| origin(at, version))?,
        axis: element(node, "axis").map_or(Ok([1.0, 0.0, 0.0]), |axis| {
            vector(axis, "xyz", [1.0, 0.0, 0.0])
        })?,
        range: match kind {
            JointKind::Continuous => [0.0; 2],
            _ => [
                number(limit, "lower", bound(f64::NEG_INFINITY))?,
                number(limit, "upper", bound(f64::INFINITY))?,
            ],
        },
        // In version 1.2 a missing speed is unlimited: for an arm it is as unknown as in earlier versions.
        velocity: match number(limit, "velocity", 0.0)? {
            f64::INFINITY => 0.0,
            velocity => velocity,
        },
        mimic: mimic.transpose()?,
        soft: soft.transpose()?,
    })
}

/// Reads an `origin`: `rpy` are angles about the fixed axes x, y, z in that order; from 1.1 on a quaternion may replace
/// them.
fn origin(node: Node<'_, '_>, version: (u32, u32)) -> Result<Isometry3<f64>, UrdfError> {
    let at = Translation3::from(Vector3::from(vector(node, "xyz", [0.0; 3])?));
    let quaternion = node.attribute("quat_xyzw").filter(|_| version >= (1, 1));
    let rotation = match quaternion {
        Some(text) if node.has_attribute("rpy") => {
            let what = "allowed beside `rpy`: keep one of them";
            return Err(malformed(node, "quat_xyzw", text, what));
        }
        Some(text) => {
            let [x, y, z, w] = numbers(text)
                .ok_or_else(|| malformed(node, "quat_xyzw", text, "a quaternion: four numbers"))?;
            let quaternion = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9);
            quaternion
                .ok_or_else(|| malformed(node, "quat_xyzw", text, "a rotation: it is zero"))?
        }
        None => {
            let [roll, pitch, yaw] = vector(node, "rpy", [0.0; 3])?;
            let rotation = Rotation3::from_euler_angles(roll, pitch, yaw);
            UnitQuaternion::from_rotation_matrix(&rotation)
        }
    };
    Ok(Isometry3::from_parts(at, rotation))
}

fn element<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children()
        .find(|child| child.is_element() && child.tag_name().name() == name)
}

fn required<'a>(node: Node<'a, '_>, name: &'static str) -> Result<&'a str, UrdfError> {
    node.attribute(name).ok_or_else(|| missing(node, name))
}

fn scalar(node: Node<'_, '_>, name: &'static str, without: f64) -> Result<f64, UrdfError> {
    let Some(text) = node.attribute(name) else {
        return Ok(without);
    };
    match numbers(text) {
        Some([number]) => Ok(number),
        None => Err(malformed(node, name, text, "a number")),
    }
}

fn vector(
    node: Node<'_, '_>,
    name: &'static str,
    without: [f64; 3],
) -> Result<[f64; 3], UrdfError> {
    let Some(text) = node.attribute(name) else {
        return Ok(without);
    };
    numbers(text).ok_or_else(|| malformed(node, name, text, "three numbers"))
}

/// Parses exactly `COUNT` numbers separated by white space.
fn numbers<const COUNT: usize>(text: &str) -> Option<[f64; COUNT]> {
    let mut all = [0.0; COUNT];
    let mut parts = text.split_whitespace();
    for number in &mut all {
        *number = parts.next()?.parse().ok()?;
    }
    parts.next().is_none().then_some(all)
}

fn missing(node: Node<'_, '_>, what: &'static str) -> UrdfError {
    let element = shortened(node.tag_name().name());
    let line = line(node);
    UrdfError::Missing {
        line,
        element,
        what,
    }
}

fn malformed(
    node: Node<'_, '_>,
    attribute: &'static str,
    value: &str,
    what: &'static str,
) -> UrdfError {
    UrdfError::Malformed {
        line: line(node),
        attribute,
        value: shortened(value),
        what,
    }
}

fn line(node: Node<'_, '_>) -> u32 {
    node.document().text_pos_at(node.range().start).row
}

/// Truncates a text and removes control characters, for use in a message.
fn shortened(text: &str) -> String {
    let clean = text
        .chars()
        .map(|sign| if sign.is_control() { ' ' } else { sign });
    let mut short: String = clean.take(60).collect();
    if text.chars().nth(60).is_some() {
        short.push('…');
    }
    short
}
