//! Rules about the net as a whole: termination, resources, monitors and size. Runs on the loader's threads.

use std::collections::BTreeMap;

use rcc_config::article::with_article;
use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_core::message::MONITOR_WIDTH_MAX;
use rcc_core::plan::{CLOCKS_MAX, INPUTS_MAX, MONITORS_MAX, TOPICS_MAX};
use rcc_core::primitive::{CYCLES_MAX, ChannelKind, ParameterKind, Role, Spec};
use rcc_core::unit::Unit;

use super::has_parameter;
use crate::codes;
use crate::infer::Typed;
use crate::resolve::{InputSource, RATE_TOLERANCE, ResolvedPrimitive, every, window, window_s};

fn of_role(net: Typed<'_>, role: Role) -> impl Iterator<Item = &ResolvedPrimitive<'_>> {
    let items = net.graph.items_of(move |spec| spec.role == role);
    items.map(|(_, item)| item)
}

/// Requires exactly one `Termination`.
pub fn there_is_one_termination(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let mut terminations = of_role(net, Role::Termination);
    let first = terminations.next();
    if first.is_none() && !net.graph.has_unknown_types {
        let message = "the net has no Termination: it could only be aborted";
        let diagnostic = Diagnostic::error(codes::NO_TERMINATION, net.graph.net.name.span, message);
        diagnostics.push(diagnostic.help("add `end: {type: Termination, inputs: {done: …}}`"));
    }
    for item in terminations {
        let first = first.map_or("", ResolvedPrimitive::id);
        let message = format!(
            "`{}` is a second Termination; `{first}` is the first one",
            item.id()
        );
        let diagnostic =
            Diagnostic::error(codes::MANY_TERMINATIONS, item.primitive.id.span, message);
        diagnostics.push(diagnostic.help(format!(
            "give `{first}` both conditions by name: `done: {{arrived: move.done, touched: touch.out}}`"
        )));
    }
}

/// Key of a resource: device, and kind and index of a channel; `None` for the arm.
type ResourceKey = (usize, Option<(usize, u32)>);

/// Returns the resource that an item commands.
fn claim(item: &ResolvedPrimitive<'_>) -> Option<(usize, Option<(ChannelKind, u32)>)> {
    match item.spec().role {
        Role::CommandsArm => Some((item.device?, None)),
        Role::CommandsChannel => {
            let kind =
                item.spec()
                    .parameters
                    .iter()
                    .find_map(|parameter| match parameter.kind {
                        ParameterKind::Channel(kind) => Some(kind),
                        _ => None,
                    })?;
            Some((item.device?, Some((kind, item.channel?.0))))
        }
        _ => None,
    }
}

/// Requires that no two primitives of a net command the same resource.
pub fn resources_are_commanded_once(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let mut holders: BTreeMap<ResourceKey, &ResolvedPrimitive<'_>> = BTreeMap::new();
    for (_, item) in net.graph.items_of(Spec::commands_device) {
        let Some((device, channel)) = claim(item) else {
            continue;
        };
        let key = (device, channel.map(|(kind, index)| (kind as usize, index)));
        let Some(holder) = holders.get(&key) else {
            holders.insert(key, item);
            continue;
        };
        let row = net.graph.cell.devices.get(device);
        let name = row.map_or("", |row| &row.name);
        let what = channel.and_then(|(kind, index)| row?.channels_of(kind).get(index as usize));
        let what = what.map_or(format!("the arm `{name}`"), |channel| {
            format!("`{}` of `{name}`", channel.name)
        });
        let message = format!(
            "`{}` commands {what}, which `{}` already commands",
            item.id(),
            holder.id()
        );
        let diagnostic = Diagnostic::error(codes::CLAIMED_TWICE, item.primitive.id.span, message);
        diagnostics.push(
            diagnostic.help("choose between the two values with Select, and command the result"),
        );
    }
}

/// Requires that a window spans 1 to [`CYCLES_MAX`] evaluations.
pub fn windows_are_possible(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (_, item) in net
        .graph
        .items_of(|spec| has_parameter(spec, ParameterKind::Window))
    {
        let Some((seconds, span)) = window_s(item) else {
            continue;
        };
        if window(item, net.graph).is_some() {
            continue;
        }
        let period_s = 1.0 / net.graph.evaluations_hz();
        let most_s = period_s * f64::from(CYCLES_MAX);
        let message = format!(
            "a window of {seconds} s is out of range: `{}` is evaluated every {period_s} s and stores 1 to {CYCLES_MAX} evaluations",
            item.id()
        );
        let span = span.unwrap_or(item.primitive.id.span);
        let diagnostic = Diagnostic::error(codes::OUT_OF_RANGE, span, message);
        diagnostics.push(diagnostic.help(format!("choose a time from {period_s} s to {most_s} s")));
    }
}

/// Requires that a monitor's value fits into a record, reads no delayed link, and has a possible rate.
pub fn monitors_are_possible(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items_of(|spec| spec.role == Role::Monitor) {
        for (_, link) in item.links().filter(|(_, link)| link.delayed) {
            let message =
                "a monitor shows the values of its own cycle and cannot read a delayed link";
            let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, link.span, message);
            diagnostics.push(diagnostic.help(format!(
                "write `value: {}`",
                net.graph.output_name(link.from)
            )));
        }
        let ports = item.spec().inputs.iter().zip(&item.inputs);
        for (port, input_source) in ports {
            let ty = net.inferred.port_type(net.graph, number, port.ty);
            let Some(ty) = ty.filter(|ty| ty.width() as usize > MONITOR_WIDTH_MAX) else {
                continue;
            };
            let message = format!(
                "a monitor shows at most {MONITOR_WIDTH_MAX} elements, found {}",
                with_article(ty)
            );
            let span = source_span(input_source).unwrap_or(item.primitive.id.span);
            let diagnostic = Diagnostic::error(codes::TOO_WIDE, span, message);
            diagnostics
                .push(diagnostic.help("monitor single elements: `value: PRIMITIVE.PORT[0]`"));
        }
        rate_is_possible(net, item, diagnostics);
    }
}

fn source_span(input_source: &InputSource<'_>) -> Option<Span> {
    match input_source {
        InputSource::Link(link) => Some(link.span),
        InputSource::Literal(literal) => Some(literal.span),
        InputSource::List(list) => Some(list.span),
        _ => None,
    }
}

fn rate_is_possible(
    net: Typed<'_>,
    item: &ResolvedPrimitive<'_>,
    diagnostics: &mut Vec<Diagnostic>,
) {
    let rows = item.spec().parameters.iter().zip(&item.parameters);
    let mut rates = rows.filter(|(parameter, _)| parameter.kind == ParameterKind::Rate);
    let Some((_, Some(literal))) = rates.next() else {
        return;
    };
    let cycle_hz = net.graph.evaluations_hz();
    let mut error = |code, message: String, help: String| {
        diagnostics.push(Diagnostic::error(code, literal.span, message).help(help));
    };
    let id = item.id();
    let has = if net.graph.rate.every > 1 {
        "the net runs at"
    } else {
        "the cell runs at"
    };
    let Some(rate) = literal.number() else {
        let message = format!("type mismatch: `{id}.rate` expects a number, found {literal}");
        return error(codes::TYPE_MISMATCH, message, "write `100 Hz`".to_string());
    };
    if let Some((have, _)) = literal
        .units()
        .into_iter()
        .find(|(unit, _)| *unit != Unit::HERTZ)
    {
        let message = format!("unit mismatch: `{id}.rate` expects Hz, found {have}");
        return error(codes::UNIT_MISMATCH, message, "write `100 Hz`".to_string());
    }
    if rate > cycle_hz * (1.0 + RATE_TOLERANCE) {
        let message = format!("the rate of `{id}` is {rate} Hz, but {has} {cycle_hz} Hz");
        return error(
            codes::RATE_TOO_HIGH,
            message,
            format!("use {cycle_hz} Hz or less"),
        );
    }
    let Some(every) = every(item, net.graph).filter(|_| rate > 0.0) else {
        if rate > 0.0 {
            let message = format!(
                "the period of `{id}` is {} s, which is too long",
                1.0 / rate
            );
            error(
                codes::OUT_OF_RANGE,
                message,
                format!("use at least {} Hz", cycle_hz / f64::from(u32::MAX)),
            );
        }
        return;
    };
    let real = cycle_hz / f64::from(every);
    if (real - rate).abs() > rate * 1e-6 {
        let message = format!("the rate of `{id}` is rounded from {rate} Hz to {real:.3} Hz");
        let diagnostic = Diagnostic::warning(codes::RATE_ROUNDED, literal.span, message);
        diagnostics.push(diagnostic.help(format!("choose a rate that divides {cycle_hz} Hz")));
    }
}

/// Requires that the numbers of monitors, inputs, motions and topics are within the limits of an executor.
pub fn counts_are_within_limits(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let divide = "split it into several nets";
    let join = "publish related values as one list: `in: [a.out, b.out]`";
    let any: fn(&&ResolvedPrimitive<'_>) -> bool = |_| true;
    let by_topic: fn(&&ResolvedPrimitive<'_>) -> bool = |item| item.topic().is_some();
    for (role, which, what, most, help) in [
        (Role::Monitor, any, "monitors", MONITORS_MAX, divide),
        (Role::Input, any, "inputs", INPUTS_MAX, divide),
        (Role::Motion, any, "motions", CLOCKS_MAX as usize, divide),
        (
            Role::Publish,
            by_topic,
            "topics that it publishes",
            TOPICS_MAX,
            join,
        ),
        (
            Role::Input,
            by_topic,
            "topics that it subscribes to",
            TOPICS_MAX,
            join,
        ),
    ] {
        let mut items = of_role(net, role).filter(which);
        if let Some(item) = items.nth(most) {
            let count = most + 1 + items.count();
            let message = format!("the net has {count} {what}, at most {most} are allowed");
            let diagnostic =
                Diagnostic::error(codes::NET_TOO_LARGE, item.primitive.id.span, message);
            diagnostics.push(diagnostic.label("the first one too many").help(help));
        }
    }
}

/// Requires that a net that commands joints is evaluated in every cycle: drivers play one set-point a cycle, so a
/// slower stream would give a staircase.
pub fn arms_are_commanded_in_every_cycle(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let every = net.graph.rate.every;
    if let (Some(item), true) = (of_role(net, Role::CommandsArm).next(), every > 1) {
        let id = item.id();
        let message =
            format!("`{id}` commands joints, and the net is evaluated only every {every} cycles");
        let diagnostic = Diagnostic::error(codes::SLOW_ARM, item.primitive.id.span, message);
        diagnostics.push(diagnostic.label("an arm needs a set-point in every cycle").help(
            "remove `period`, `rate` and `phase`, and move the slower part to a net of its own",
        ));
    }
}

/// Warns if a net commands an arm and has no `Cancel`.
pub fn commands_can_be_canceled(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let commands = of_role(net, Role::CommandsArm).next();
    let can_cancel = of_role(net, Role::Cancel).next().is_some();
    if let (Some(item), false) = (commands, can_cancel || net.graph.has_unknown_types) {
        let message = "this net commands an arm and has no Cancel: it can only be aborted";
        let diagnostic =
            Diagnostic::warning(codes::NOT_CANCELABLE, item.primitive.id.span, message);
        diagnostics.push(
            diagnostic
                .help("add `cancel: {type: Cancel}` and let `cancel.requested` stop the motion"),
        );
    }
}
