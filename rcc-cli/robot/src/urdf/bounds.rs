//! Refuses texts before XML parsing that are too long, nested too deep, or have too many attributes. XML parsers
//! compare each attribute of an element with each other, and each new element with each open one: with these bounds,
//! parsing takes linear time. One pass, no allocation.

use super::UrdfError;

/// Longest text, bytes; a large robot has some hundred thousand.
pub const BYTES_MAX: usize = 8 << 20;
/// Greatest nesting depth; a URDF needs about six.
pub const DEPTH_MAX: usize = 32;
/// Largest number of attributes of an element; a URDF needs about seven.
pub const ATTRIBUTES_MAX: usize = 64;

/// Checks the bounds. Ill-formed text is left to the parser.
pub(super) fn check(text: &str) -> Result<(), UrdfError> {
    if text.len() > BYTES_MAX {
        let size = text.len();
        return Err(UrdfError::TooLarge { size });
    }
    let (mut rest, mut depth) = (text, 0_usize);
    while let Some(at) = rest.find('<') {
        rest = &rest[at..];
        let here = || text[..text.len() - rest.len()].matches('\n').count() + 1;
        let length = if rest.starts_with("<!--") {
            past(rest, "-->")
        } else if rest.starts_with("<![CDATA[") {
            past(rest, "]]>")
        } else if rest.starts_with("<?") {
            past(rest, "?>")
        } else if rest.starts_with("</") {
            depth = depth.saturating_sub(1);
            past(rest, ">")
        } else {
            let Some(tag) = tag(rest) else {
                return Ok(());
            };
            if tag.attributes > ATTRIBUTES_MAX {
                return Err(UrdfError::TooManyAttributes { line: here() });
            }
            depth += usize::from(tag.opens);
            if depth > DEPTH_MAX {
                return Err(UrdfError::TooDeep { line: here() });
            }
            Some(tag.length)
        };
        let Some(length) = length else {
            return Ok(());
        };
        rest = &rest[length..];
    }
    Ok(())
}

struct XmlTag {
    /// Length up to and including its `>`, bytes.
    length: usize,
    /// True unless the tag closes itself.
    opens: bool,
    attributes: usize,
}

/// Parses the tag at the start of a text; `None` if it is not terminated.
fn tag(text: &str) -> Option<XmlTag> {
    let (mut quote, mut attributes, mut before) = (None, 0, b'<');
    for (at, byte) in text.bytes().enumerate() {
        match (quote, byte) {
            (Some(open), _) if open == byte => quote = None,
            (Some(_), _) => {}
            (None, b'"' | b'\'') => quote = Some(byte),
            (None, b'=') => attributes += 1,
            (None, b'>') => {
                return Some(XmlTag {
                    length: at + 1,
                    opens: before != b'/',
                    attributes,
                });
            }
            (None, _) => {}
        }
        before = byte;
    }
    None
}

/// Returns the length up to and including `end`, bytes.
fn past(text: &str, end: &str) -> Option<usize> {
    text.find(end).map(|at| at + end.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nested(depth: usize) -> String {
        format!(
            "<robot>{}{}</robot>",
            "<a>".repeat(depth),
            "</a>".repeat(depth)
        )
    }

    #[test]
    fn elements_are_as_deep_as_allowed_and_no_deeper() {
        assert_eq!(check(&nested(DEPTH_MAX - 1)), Ok(()));
        let deep = check(&format!("\n\n{}", nested(DEPTH_MAX)));
        assert_eq!(deep, Err(UrdfError::TooDeep { line: 3 }));
        let beside = "<a/><b></b><!-- <c> --><![CDATA[<d>]]><?e <f>?>".repeat(1000);
        assert_eq!(check(&format!("<robot>{beside}</robot>")), Ok(()));
    }

    #[test]
    fn an_element_has_as_many_attributes_as_allowed_and_no_more() {
        let with = |count: usize| {
            let attributes = (0..count).map(|at| format!(" a{at}='='"));
            format!("<robot{}/>", attributes.collect::<String>())
        };
        assert_eq!(check(&with(ATTRIBUTES_MAX)), Ok(()));
        let many = check(&with(ATTRIBUTES_MAX + 1));
        assert_eq!(many, Err(UrdfError::TooManyAttributes { line: 1 }));
    }

    #[test]
    fn a_text_that_is_too_long_is_refused() {
        let long = " ".repeat(BYTES_MAX + 1);
        assert!(matches!(check(&long), Err(UrdfError::TooLarge { .. })));
        assert_eq!(check(&long[..BYTES_MAX]), Ok(()));
    }

    #[test]
    fn unterminated_markup_is_left_to_the_parser() {
        for text in [
            "<",
            "<a",
            "<a b='",
            "<!--",
            "<![CDATA[",
            "<?",
            "</",
            "a > b",
            "<>",
        ] {
            assert_eq!(check(text), Ok(()), "{text}");
        }
    }
}
