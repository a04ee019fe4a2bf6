//! Values from and to the application, and between nets. Runs in `rcc-cli convert`.

use rcc_language::syntax::Primitive;
use rcc_language::syntax::literal::{Literal, LiteralShape};

use super::{TextWriter, family};
use crate::values::ForeignType;

impl TextWriter<'_, '_> {
    /// Returns the item of a value from or to the application; its id is the key.
    pub(super) fn keyed(&mut self, primitive: &Primitive, suffix: &str) -> Vec<String> {
        let id = &primitive.id.name;
        let Some((ty, prefix)) = self.family_of(primitive, "value") else {
            return Vec::new();
        };
        let mut arguments = vec![format!("Key='{id}'")];
        for (name, literal) in &primitive.parameters {
            match name.name.as_str() {
                "initial" => arguments.push(format!("Value='{}'", self.constant(literal, ty))),
                // The server decides how often a value is sent.
                "rate" => {}
                // The family implies the type, and there are no units.
                "type" | "unit" => {}
                other => self.refuse(name.span, format!("the parameter `{other}`")),
            }
        }
        if suffix == "NetcommOut" {
            let value = self.input(primitive, "value", ty).unwrap_or_default();
            arguments.push(format!("inValue={value}"));
        }
        vec![format!("{id}={prefix}{suffix}({})", arguments.join(","))]
    }

    /// Returns the item of a value for other nets: of this net under its name, or of another net's input as the topic
    /// says.
    pub(super) fn published(&mut self, primitive: &Primitive) -> Vec<String> {
        let Some((ty, prefix, topic)) = self.topic(primitive, "out") else {
            return Vec::new();
        };
        let id = &primitive.id.name;
        let value = self.input(primitive, "in", ty).unwrap_or_default();
        let own = topic.strip_prefix(&format!("{}/out", self.net.name.name));
        let what = match (own, topic.split_once("/in")) {
            (Some(key), _) if !key.is_empty() => format!("NetcommOut(Key='{key}',Report='false'"),
            (None, Some((net, key))) if !net.is_empty() && !key.is_empty() => {
                format!("InterNetcommOut(RemoteNet='{net}',RemoteKey='{key}'")
            }
            _ => {
                self.no_topic(primitive, &topic);
                return Vec::new();
            }
        };
        vec![format!("{id}={prefix}{what},inValue={value})")]
    }

    /// Returns the item of a value from another net.
    pub(super) fn subscribed(&mut self, primitive: &Primitive) -> Vec<String> {
        let Some((_, prefix, topic)) = self.topic(primitive, "value") else {
            return Vec::new();
        };
        for (name, _) in &primitive.parameters {
            if !["topic", "type", "unit"].contains(&name.name.as_str()) {
                self.refuse(name.span, format!("the parameter `{}`", name.name));
            }
        }
        let parts = topic.split_once("/out");
        let Some((net, key)) = parts.filter(|(net, key)| !net.is_empty() && !key.is_empty()) else {
            self.no_topic(primitive, &topic);
            return Vec::new();
        };
        let id = &primitive.id.name;
        vec![format!(
            "{id}={prefix}InterNetcommIn(RemoteNet='{net}',RemoteKey='{key}')"
        )]
    }

    /// Returns the predecessor's type of a port, the prefix of its family, and the topic of the primitive.
    fn topic(
        &mut self,
        primitive: &Primitive,
        port: &str,
    ) -> Option<(ForeignType, &'static str, String)> {
        let mut parameters = primitive.parameters.iter();
        let (_, topic) = parameters.find(|(name, _)| name.name == "topic")?;
        let Literal {
            shape: LiteralShape::Text(topic),
            ..
        } = topic
        else {
            return None;
        };
        let (ty, prefix) = self.family_of(primitive, port)?;
        Some((ty, prefix, topic.clone()))
    }

    /// Returns the predecessor's type of a port, and the prefix of its family.
    fn family_of(
        &mut self,
        primitive: &Primitive,
        port: &str,
    ) -> Option<(ForeignType, &'static str)> {
        let ty = self.type_of(&primitive.id.name, port);
        let found = ty.and_then(|ty| Some((ty, family(ty)?)));
        if found.is_none() {
            let what = format!("`{}` of an array", primitive.type_name.name);
            self.refuse(primitive.id.span, what);
        }
        found
    }

    fn no_topic(&mut self, primitive: &Primitive, topic: &str) {
        let own = &self.net.name.name;
        self.refuse(
            primitive.id.span,
            format!("the topic `{topic}`; write `{own}/outKEY` or `NET/inKEY`"),
        );
    }
}
