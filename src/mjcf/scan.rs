//! A first pass over the raw text: it bounds what the XML parser will see, and forgives what people write.
//!
//! The parser is quadratic in the attributes of one element and in namespaces, so this pass bounds the former and the
//! depth, and lets none of the latter through. The parser is also stricter than MuJoCo's: it rejects blanks before the
//! declaration, `--` in comments, attributes without a blank between them, and `<` or a lone `&` in a value. So this pass
//! blanks declarations, plain document types, comments and what belongs to namespaces, and mends the rest. Every line
//! stays in its place.

/// Most bytes of a model, all files together.
pub(super) const MOST_BYTES: usize = 64 << 20;
/// Most attributes of one element.
const MOST_ATTRIBUTES: usize = 128;
/// Most attributes of one file.
const MOST_IN_ALL: usize = 4_000_000;
/// Deepest nesting of elements.
const DEEPEST: usize = 50_000;

/// What is wrong, on which line, and what to do.
pub(super) struct Fault {
    pub line: u32,
    pub message: String,
    pub remedy: &'static str,
}

/// Checks the limits and returns the text as the XML parser will accept it.
pub(super) fn scan(text: &str) -> Result<String, Fault> {
    let bytes = text.as_bytes();
    let mut scan = Scan { out: Vec::with_capacity(bytes.len()), depth: 0, attributes: 0, root: true };
    let mut at = 0;
    while at < bytes.len() {
        at += scan.next(&bytes[at..]).map_err(|(message, remedy)| fault(bytes, at, message, remedy))?;
    }
    String::from_utf8(scan.out).map_err(|_| Fault { line: 0, message: "the text is broken".into(), remedy: "" })
}

fn fault(bytes: &[u8], at: usize, message: String, remedy: &'static str) -> Fault {
    let line = 1 + bytes[..at].iter().filter(|&&b| b == b'\n').count();
    Fault { line: u32::try_from(line).unwrap_or(u32::MAX), message, remedy }
}

/// What has been scanned.
struct Scan {
    out: Vec<u8>,
    depth: usize,
    attributes: usize,
    /// Whether the next element is the root.
    root: bool,
}

/// A message and a remedy.
type Wrong = (String, &'static str);

impl Scan {
    /// Takes one piece of markup, or the text up to the next; returns its length.
    fn next(&mut self, rest: &[u8]) -> Result<usize, Wrong> {
        let length = if rest.starts_with(b"<!--") {
            let length = end_of(rest, 4, b"-->");
            return Ok(self.blank(&rest[..length], b"<!--", b"-->"));
        } else if rest.starts_with(b"<?") {
            let length = end_of(rest, 2, b"?>");
            return Ok(self.blank(&rest[..length], b"<?", b"?>"));
        } else if rest.starts_with(b"<!DOCTYPE") {
            // One with declarations of its own goes to the parser, which rejects it.
            let length = end_of(rest, 9, b">");
            if !rest[..length].contains(&b'[') {
                return Ok(self.blank(&rest[..length], b"<!DOCTYPE", b">"));
            }
            length
        } else if rest.starts_with(b"<![CDATA[") {
            end_of(rest, 9, b"]]>")
        } else if rest[0] == b'<' {
            return self.tag(rest);
        } else {
            let text = &rest[..rest.iter().position(|&b| b == b'<').unwrap_or(rest.len())];
            // Text means nothing within the root, whatever it is; a NUL ends the file for MuJoCo.
            if self.depth > 0 && !text.contains(&0) {
                return Ok(self.blank(text, b"", b""));
            }
            text.len()
        };
        self.out.extend_from_slice(&rest[..length]);
        Ok(length)
    }

    /// Writes nothing of a piece but its line breaks; one that does not end stays as it is, for the parser to reject.
    fn blank(&mut self, piece: &[u8], start: &[u8], end: &[u8]) -> usize {
        if piece.len() >= start.len() + end.len() && piece.ends_with(end) {
            self.out.extend(piece.iter().map(|&b| if b == b'\n' { b'\n' } else { b' ' }));
        } else {
            self.out.extend_from_slice(piece);
        }
        piece.len()
    }

    fn tag(&mut self, rest: &[u8]) -> Result<usize, Wrong> {
        let tag = measure(rest);
        if tag.attributes > MOST_ATTRIBUTES {
            let message = format!("an element has {} attributes, more than {MOST_ATTRIBUTES}", tag.attributes);
            return Err((message, "remove attributes"));
        }
        self.attributes += tag.attributes;
        if self.attributes > MOST_IN_ALL {
            return Err((format!("the file has more than {MOST_IN_ALL} attributes"), "split the model"));
        }
        match tag.kind {
            Kind::Open => self.depth += 1,
            Kind::Close => self.depth = self.depth.saturating_sub(1),
            Kind::Other => {}
        }
        if self.depth > DEEPEST {
            return Err((format!("elements are nested more than {DEEPEST} deep"), "nest less"));
        }
        self.write(&rest[..tag.length])?;
        self.root = false;
        Ok(tag.length)
    }

    /// Writes a tag: values as the parser wants them, a blank after each, and at the root nothing that has a prefix.
    fn write(&mut self, tag: &[u8]) -> Result<(), Wrong> {
        let name = tag.iter().position(|b| b.is_ascii_whitespace() || b"/>".contains(b)).unwrap_or(tag.len());
        let name =
            if name < 2 { tag.iter().skip(2).position(|&b| b == b'>').map_or(tag.len(), |i| i + 2) } else { name };
        if tag[..name].contains(&b':') {
            let name = String::from_utf8_lossy(&tag[1..name]);
            let message = format!("element \"{}\": MJCF has no prefixes", crate::diagnostics::shorten(&name));
            return Err((message, "expand macros first, or remove it"));
        }
        self.out.extend_from_slice(&tag[..name]);
        let mut start = name;
        while let Some(open) = tag[start..].iter().position(|b| b"\"'".contains(b)).map(|i| start + i) {
            let Some(length) = tag[open + 1..].iter().position(|&b| b == tag[open]) else { break };
            let end = open + 1 + length;
            let before = &tag[start..open];
            let name = before.split(|&b| b == b'=').next().unwrap_or_default().trim_ascii();
            let prefixed = name == b"xmlns" || name.contains(&b':');
            if prefixed && !self.root {
                let name = String::from_utf8_lossy(name);
                let message = format!("attribute \"{}\": MJCF has no prefixes", crate::diagnostics::shorten(&name));
                return Err((message, "remove it; the root element may have such attributes, which mean nothing"));
            } else if prefixed {
                self.out.extend(tag[start..=end].iter().map(|&b| if b == b'\n' { b'\n' } else { b' ' }));
            } else {
                self.out.extend_from_slice(before);
                self.out.push(tag[open]);
                self.value(&tag[open + 1..end]);
                self.out.push(tag[open]);
                self.out.push(b' ');
            }
            start = end + 1;
        }
        self.out.extend_from_slice(&tag[start..]);
        Ok(())
    }

    /// Writes a value with `<`, and every `&` that starts no reference, escaped.
    fn value(&mut self, value: &[u8]) {
        for (i, &b) in value.iter().enumerate() {
            match b {
                b'<' => self.out.extend_from_slice(b"&lt;"),
                b'&' if !is_reference(&value[i + 1..]) => self.out.extend_from_slice(b"&amp;"),
                b => self.out.push(b),
            }
        }
    }
}

/// Whether what follows an ampersand names a character.
fn is_reference(rest: &[u8]) -> bool {
    const LONGEST: usize = 10;
    let Some(end) = rest.iter().take(LONGEST).position(|&b| b == b';') else { return false };
    let name = &rest[..end];
    let digits = |digits: &[u8], are: fn(&u8) -> bool| !digits.is_empty() && digits.iter().all(are);
    match name {
        b"amp" | b"lt" | b"gt" | b"quot" | b"apos" => true,
        [b'#', b'x', hex @ ..] => digits(hex, u8::is_ascii_hexdigit),
        [b'#', decimal @ ..] => digits(decimal, u8::is_ascii_digit),
        _ => false,
    }
}

/// Where the first `needle` at or after `from` ends, or the end of the text.
fn end_of(bytes: &[u8], from: usize, needle: &[u8]) -> usize {
    let tail = bytes.get(from..).unwrap_or_default();
    tail.windows(needle.len()).position(|w| w == needle).map_or(bytes.len(), |i| from + i + needle.len())
}

enum Kind {
    Open,
    Close,
    Other,
}

struct Tag {
    kind: Kind,
    attributes: usize,
    length: usize,
}

/// Measures the tag that `bytes` starts with.
fn measure(bytes: &[u8]) -> Tag {
    let mut attributes = 0;
    let mut quote = None;
    let mut previous = 0;
    for (i, &b) in bytes.iter().enumerate().skip(1) {
        match quote {
            Some(q) if b == q => quote = None,
            Some(_) => {}
            None => match b {
                b'"' | b'\'' => quote = Some(b),
                b'=' => attributes += 1,
                b'>' => {
                    let kind = match bytes.get(1) {
                        Some(b'/') => Kind::Close,
                        Some(b'!') => Kind::Other,
                        _ if previous == b'/' => Kind::Other,
                        _ => Kind::Open,
                    };
                    return Tag { kind, attributes, length: i + 1 };
                }
                _ => {}
            },
        }
        previous = b;
    }
    Tag { kind: Kind::Other, attributes, length: bytes.len() }
}
