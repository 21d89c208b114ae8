//! Names by pattern: `frames/{scene}.####.exr`.

/// What a pattern may name: the frame, and values by name.
pub(super) struct Fields<'a> {
    /// Number of the frame.
    pub frame: u64,
    /// `scene`, `name`, and whatever is set, with its value.
    pub values: &'a [(String, String)],
}

/// Whether the pattern gives another name for another frame.
pub(super) fn has_frame(pattern: &str) -> bool {
    pattern.contains('#') || pattern.contains("{frame}")
}

/// Fills in a pattern: a row of `#` is the frame with at least as many digits, `{NAME}` a value. Slashes and blanks in
/// values become `_`.
pub(super) fn fill(pattern: &str, fields: &Fields) -> Result<String, String> {
    let mut text = String::new();
    let mut rest = pattern;
    while let Some(at) = rest.find(['#', '{']) {
        text.push_str(&rest[..at]);
        rest = &rest[at..];
        if rest.starts_with('#') {
            let digits = rest.len() - rest.trim_start_matches('#').len();
            text.push_str(&format!("{:0digits$}", fields.frame));
            rest = &rest[digits..];
            continue;
        }
        let Some(end) = rest.find('}') else {
            return Err(format!("\"{pattern}\" has a {{ without its }}"));
        };
        let name = &rest[1..end];
        match fields.values.iter().find(|(known, _)| known == name) {
            Some((_, value)) => text.extend(value.chars().map(plain)),
            None if name == "frame" => text.push_str(&fields.frame.to_string()),
            None => {
                let known: Vec<&str> = fields.values.iter().map(|(name, _)| name.as_str()).collect();
                return Err(format!("\"{pattern}\" names {{{name}}}; expected frame, {}", known.join(", ")));
            }
        }
        rest = &rest[end + 1..];
    }
    text.push_str(rest);
    Ok(text)
}

fn plain(c: char) -> char {
    if c == '/' || c == '\\' || c.is_whitespace() || c.is_control() { '_' } else { c }
}

/// A name that can be that of a file.
pub(super) fn file_name(name: &str) -> String {
    let name: String = name.chars().map(plain).collect();
    // Not hidden, and not a way up.
    match name.strip_prefix('.') {
        Some(rest) => format!("_{rest}"),
        None => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns() {
        let values =
            [("scene".to_string(), "box".to_string()), ("camera.eye".to_string(), "1 0 2".to_string())];
        let fill = |pattern| fill(pattern, &Fields { frame: 7, values: &values });
        assert_eq!(fill("a/{scene}.####.exr").unwrap(), "a/box.0007.exr");
        assert_eq!(fill("{camera.eye}-{frame}#").unwrap(), "1_0_2-77");
        assert_eq!(fill("plain.exr").unwrap(), "plain.exr");
        assert!(fill("{camera.fov}").unwrap_err().contains("expected frame, scene, camera.eye"));
        assert!(fill("{scene").unwrap_err().contains("without its }"));
        assert!(has_frame("a.#.exr") && has_frame("{frame}") && !has_frame("{scene}.exr"));
        assert_eq!((file_name("../a b"), file_name("a")), ("_._a_b".into(), "a".into()));
    }
}
