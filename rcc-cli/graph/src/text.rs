//! Upper bounds of text widths without knowing the reader's fonts: widths of DejaVu Sans, one of the widest fallback
//! fonts of browsers. Pure.

/// Returns the width of a text, in the unit of `size`.
#[must_use]
pub fn width(text: &str, size: f64) -> f64 {
    let sum: f64 = text.chars().map(character_width).sum();
    sum * size
}

/// Returns the width of a character, relative to the size.
fn character_width(letter: char) -> f64 {
    match letter {
        'i' | 'j' | 'l' | '\'' | '|' => 0.30,
        'I' | '.' | ',' | ':' | ';' | ' ' | '·' => 0.34,
        'f' | 't' | 'r' | '(' | ')' | '[' | ']' | '-' | '/' | '!' => 0.42,
        'm' | 'w' | 'M' | 'W' | '%' | '@' | '…' | '—' => 0.99,
        'A'..='Z' | '=' | '<' | '>' | '+' | '→' | '∅' | '∞' => 0.84,
        letter if letter.is_ascii() => 0.64,
        letter if u32::from(letter) < 0x2000 => 0.70,
        _ => 1.05,
    }
}

/// Returns the text, truncated with an ellipsis if it is wider than `most`.
#[must_use]
pub fn fit(text: &str, size: f64, most: f64) -> String {
    if width(text, size) <= most {
        return text.to_owned();
    }
    let mut kept = String::new();
    let mut used = width("…", size);
    for letter in text.chars() {
        used += character_width(letter) * size;
        if used > most {
            break;
        }
        kept.push(letter);
    }
    kept.push('…');
    kept
}

/// Breaks the text at blanks into at most `count` lines of at most this width.
#[must_use]
pub fn lines(text: &str, size: f64, most: f64, count: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line)
                if width(line, size) + width(word, size) + character_width(' ') * size <= most =>
            {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    if lines.len() > count {
        lines.truncate(count);
        if let Some(last) = lines.last_mut() {
            last.push_str(" …");
        }
    }
    lines.iter().map(|line| fit(line, size, most)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_that_is_too_long_ends_with_an_ellipsis_and_fits() {
        assert_eq!(fit("short", 10.0, 100.0), "short");
        let cut = fit("a very long name indeed", 10.0, 60.0);
        assert!(cut.ends_with('…') && width(&cut, 10.0) <= 60.0, "{cut}");
    }

    #[test]
    fn lines_break_at_blanks_and_none_is_too_wide() {
        let text = "a line that stops softly on contact or on cancel";
        let broken = lines(text, 10.0, 120.0, 9);
        assert_eq!(broken.join(" "), text);
        assert!(broken.iter().all(|line| width(line, 10.0) <= 120.0));
        assert_eq!(lines(text, 10.0, 120.0, 2).len(), 2);
    }
}
