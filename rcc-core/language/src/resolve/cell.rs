//! Resolves parameters that are names: devices and channels of the cell, topics, types, units and words. Runs on the
//! loader's threads.

use rcc_config::article::with_article;
use rcc_config::device::{CHANNEL_KINDS, kind_name};
use rcc_config::diagnostic::Span;
use rcc_core::primitive::{ChannelKind, Parameter, ParameterKind, Spec};
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use super::{ResolvedPrimitive, Resolver};
use crate::codes;
use crate::devices::CellDevice;
use crate::syntax::declaration::{TYPES, parse_type, si_unit};
use crate::syntax::literal::{Literal, LiteralShape};

/// Help text for an invalid unit.
const DECLARED_UNITS_HELP: &str =
    "write an SI unit such as `m/s`, `N`, `rad`; a plain number needs no `unit`";
/// Longest name of a topic, characters.
const TOPIC_MAX: usize = 64;

/// Returns the type that a literal names. `Text` is not a port type.
fn declared_type(literal: &Literal) -> Option<Type> {
    match &literal.shape {
        LiteralShape::Text(name) => parse_type(name).filter(|ty| *ty != Type::Text),
        _ => None,
    }
}

/// Returns the SI unit that a literal names.
fn declared_unit(literal: &Literal) -> Option<Unit> {
    match &literal.shape {
        LiteralShape::Text(name) => si_unit(name),
        _ => None,
    }
}

impl ResolvedPrimitive<'_> {
    fn declared<T>(
        &self,
        is_it: impl Fn(ParameterKind) -> bool,
        read: impl Fn(&Literal) -> Option<T>,
    ) -> Option<T> {
        let mut rows = self.spec().parameters.iter().zip(&self.parameters);
        let (_, literal) = rows.find(|(parameter, _)| is_it(parameter.kind))?;
        read((*literal)?)
    }

    /// Returns the open type, if a parameter declares it.
    pub(crate) fn declared_type(&self) -> Option<Type> {
        self.declared(|kind| kind == ParameterKind::Type, declared_type)
    }

    /// Returns a unit variable and the unit that a parameter declares for it.
    pub(crate) fn declared_unit(&self) -> Option<(u8, Unit)> {
        let mut kinds = self.spec().parameters.iter().map(|row| row.kind);
        let variable = kinds.find_map(|kind| match kind {
            ParameterKind::Unit(variable) => Some(variable),
            _ => None,
        })?;
        let is_it = |kind| matches!(kind, ParameterKind::Unit(_));
        Some((variable, self.declared(is_it, declared_unit)?))
    }
}

impl<'a> Resolver<'a, '_> {
    /// Returns the index of the device, and index and unit of the channel, that the parameters of a primitive name.
    pub(super) fn device_and_channel(
        &mut self,
        spec: &Spec,
        parameters: &[Option<&'a Literal>],
    ) -> (Option<usize>, Option<(u32, Unit)>) {
        let cell = self.cell;
        let mut device = None;
        let mut channel = None;
        for (parameter, literal) in spec.parameters.iter().zip(parameters) {
            let Some(literal) = *literal else { continue };
            match parameter.kind {
                ParameterKind::Device | ParameterKind::Arm => {
                    let found = self
                        .name(parameter, literal)
                        .and_then(|name| self.device(name, literal.span));
                    device = found.filter(|(_, row)| {
                        parameter.kind == ParameterKind::Device
                            || self.is_arm(spec, row, literal.span)
                    });
                }
                ParameterKind::Channel(kind) => {
                    let name = self.name(parameter, literal);
                    if let (Some(name), Some((_, row))) = (name, device) {
                        channel = self.channel(kind, name, row, literal.span);
                    }
                }
                ParameterKind::Word(words) => self.word(parameter, words, literal),
                ParameterKind::Topic => self.topic(parameter, literal),
                ParameterKind::Type | ParameterKind::Unit(_) => {
                    self.check_declaration(parameter, literal)
                }
                _ => {}
            }
        }
        let device = device.map(|(index, _)| index);
        debug_assert!(device.is_none_or(|index| index < cell.devices.len()));
        (device, channel)
    }

    /// Returns the text of a parameter that is a name.
    fn name(&mut self, parameter: &Parameter, literal: &'a Literal) -> Option<&'a str> {
        if let LiteralShape::Text(name) = &literal.shape {
            return Some(name);
        }
        let message = format!("`{}` must be a name, not {literal}", parameter.name);
        let help = parameter.doc.to_string();
        self.error(codes::WRONG_SHAPE, literal.span, message, Some(help));
        None
    }

    fn word(&mut self, parameter: &Parameter, words: &[&'static str], literal: &'a Literal) {
        if literal.word(words).is_some() {
            return;
        }
        let known = words.iter().copied();
        let help = match &literal.shape {
            LiteralShape::Text(name) => self.suggestions.word(name, "words", known, None),
            _ => format!("words: {}", words.join(", ")),
        };
        let message = format!("`{}` must be a word, not {literal}", parameter.name);
        let message = match &literal.shape {
            LiteralShape::Text(name) => format!("`{}` cannot be `{name}`", parameter.name),
            _ => message,
        };
        self.error(codes::WRONG_SHAPE, literal.span, message, Some(help));
    }

    fn topic(&mut self, parameter: &Parameter, literal: &'a Literal) {
        let Some(name) = self.name(parameter, literal) else {
            return;
        };
        let is_valid = |c: char| c.is_ascii_alphanumeric() || "_-./".contains(c);
        let begins = name.starts_with(|c: char| c.is_ascii_alphabetic());
        if !begins || name.len() > TOPIC_MAX || !name.chars().all(is_valid) {
            let message = format!("invalid topic name `{name}`");
            let help = format!(
                "use a letter followed by letters, digits and `_ - . /`, at most {TOPIC_MAX} characters, as in `tool/force`"
            );
            self.error(codes::BAD_NAME, literal.span, message, Some(help));
        }
    }

    /// Checks a declared type or unit.
    fn check_declaration(&mut self, parameter: &Parameter, literal: &'a Literal) {
        let (is_valid, help) = match parameter.kind {
            ParameterKind::Type => (declared_type(literal).is_some(), TYPES),
            _ => (declared_unit(literal).is_some(), DECLARED_UNITS_HELP),
        };
        if !is_valid && literal.shape != LiteralShape::Null {
            let message = format!("invalid {}: {literal}", parameter.name);
            self.error(codes::WRONG_SHAPE, literal.span, message, Some(help.into()));
        }
    }

    fn device(&mut self, name: &str, span: Span) -> Option<(usize, &'a CellDevice)> {
        let found = self.cell.find(name);
        if found.is_none() {
            let names = self.cell.devices.iter().map(|device| device.name.as_str());
            let help = self.suggestions.word(name, "devices", names, None);
            let message = format!("the cell has no device `{name}`");
            self.error(codes::UNKNOWN_DEVICE, span, message, Some(help));
        }
        found
    }

    fn is_arm(&mut self, spec: &Spec, device: &CellDevice, span: Span) -> bool {
        let is_arm = device.model.arm.is_some();
        if !is_arm {
            let arms = self
                .cell
                .devices
                .iter()
                .filter(|device| device.model.arm.is_some());
            let names: Vec<&str> = arms.map(|device| device.name.as_str()).collect();
            let help = match names.as_slice() {
                [] => "the cell has no arm".to_string(),
                names => format!("arms of the cell: {}", names.join(", ")),
            };
            let message = format!(
                "{} needs an arm, and `{}` is not one",
                spec.name, device.name
            );
            self.error(codes::NO_ARM, span, message, Some(help));
        }
        is_arm
    }

    fn channel(
        &mut self,
        kind: ChannelKind,
        name: &str,
        device: &CellDevice,
        span: Span,
    ) -> Option<(u32, Unit)> {
        let channels = device.channels_of(kind);
        if let Some((channel, index)) = channels
            .iter()
            .zip(0u32..)
            .find(|(row, _)| row.name == name)
        {
            return Some((index, channel.unit));
        }
        let other = CHANNEL_KINDS.into_iter().find(|kind| {
            let channels = device.channels_of(*kind);
            channels.iter().any(|channel| channel.name == name)
        });
        let names = channels.iter().map(|channel| channel.name.as_str());
        let what = format!("{}s of `{}`", kind_name(kind), device.name);
        let other = other.map(|kind| with_article(kind_name(kind)));
        let help = self.suggestions.word(name, &what, names, other.as_deref());
        let message = format!("`{}` has no {} `{name}`", device.name, kind_name(kind));
        self.error(codes::UNKNOWN_CHANNEL, span, message, Some(help));
        None
    }
}
