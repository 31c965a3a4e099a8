//! A first pass over the raw text that bounds what the XML parser will see.
//!
//! The parser is quadratic in the attributes of one element and in nested namespaces, so this pass counts the former,
//! rejects the latter, and bounds the depth. The parser is also stricter than MuJoCo's: it rejects `--` in comments and
//! attributes without a blank between them. So this pass blanks the inside of comments and adds such blanks, keeping every
//! line in its place.

/// Most bytes of a model, all files together.
pub(super) const MOST_BYTES: usize = 64 << 20;
/// Most attributes of one element.
const MOST_ATTRIBUTES: usize = 128;
/// Deepest nesting of elements.
const DEEPEST: usize = 50_000;

/// What is wrong, and on which line.
pub(super) struct Fault {
    pub line: u32,
    pub message: String,
}

/// Checks the limits and returns the text as the XML parser will accept it.
pub(super) fn scan(text: &str) -> Result<String, Fault> {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut depth = 0usize;
    let mut at = 0;
    while at < bytes.len() {
        let rest = &bytes[at..];
        let end = if rest.starts_with(b"<!--") {
            let end = at + find(rest, 4, b"-->");
            blank(&bytes[at..end], &mut out);
            at = end;
            continue;
        } else if rest.starts_with(b"<![CDATA[") {
            at + find(rest, 9, b"]]>")
        } else if rest.starts_with(b"<?") {
            at + find(rest, 2, b"?>")
        } else if rest[0] == b'<' {
            let tag = tag(rest);
            if tag.attributes > MOST_ATTRIBUTES {
                return Err(fault(bytes, at, format!("an element has more than {MOST_ATTRIBUTES} attributes")));
            }
            if tag.namespace {
                return Err(fault(bytes, at, "namespaces (xmlns) are not part of MJCF".into()));
            }
            match tag.kind {
                Kind::Open => depth += 1,
                Kind::Close => depth = depth.saturating_sub(1),
                Kind::Other => {}
            }
            if depth > DEEPEST {
                return Err(fault(bytes, at, format!("elements are nested more than {DEEPEST} deep")));
            }
            separate(&rest[..tag.length], &mut out);
            at += tag.length;
            continue;
        } else {
            at + rest.iter().position(|&b| b == b'<').unwrap_or(rest.len())
        };
        out.extend_from_slice(&bytes[at..end]);
        at = end;
    }
    String::from_utf8(out).map_err(|_| Fault { line: 0, message: "a comment is broken".into() })
}

fn fault(bytes: &[u8], at: usize, message: String) -> Fault {
    let line = 1 + bytes[..at].iter().filter(|&&b| b == b'\n').count();
    Fault { line: u32::try_from(line).unwrap_or(u32::MAX), message }
}

/// The end of the first `needle` at or after `from`, or the end of the text.
fn find(bytes: &[u8], from: usize, needle: &[u8]) -> usize {
    let tail = bytes.get(from..).unwrap_or_default();
    tail.windows(needle.len()).position(|w| w == needle).map_or(bytes.len(), |i| from + i + needle.len())
}

/// Writes a comment with nothing in it but its line breaks. An unterminated one stays as it is, for the parser to reject.
fn blank(comment: &[u8], out: &mut Vec<u8>) {
    if comment.len() < 7 || !comment.ends_with(b"-->") {
        out.extend_from_slice(comment);
        return;
    }
    out.extend_from_slice(b"<!--");
    out.extend(comment[4..comment.len() - 3].iter().map(|&b| if b == b'\n' { b'\n' } else { b' ' }));
    out.extend_from_slice(b"-->");
}

/// Writes a tag with a blank after each attribute that lacks one.
fn separate(tag: &[u8], out: &mut Vec<u8>) {
    let mut quote = None;
    for (i, &b) in tag.iter().enumerate() {
        out.push(b);
        match quote {
            Some(q) if b == q => {
                quote = None;
                if tag.get(i + 1).is_some_and(|next| !next.is_ascii_whitespace() && !b"/>?".contains(next)) {
                    out.push(b' ');
                }
            }
            Some(_) => {}
            None if b == b'"' || b == b'\'' => quote = Some(b),
            None => {}
        }
    }
}

enum Kind {
    Open,
    Close,
    Other,
}

struct Tag {
    kind: Kind,
    attributes: usize,
    /// Whether it declares a namespace.
    namespace: bool,
    length: usize,
}

/// Measures the tag that `bytes` starts with.
fn tag(bytes: &[u8]) -> Tag {
    let (mut attributes, mut namespace) = (0, false);
    let mut quote = None;
    let mut previous = 0;
    for (i, &b) in bytes.iter().enumerate().skip(1) {
        match quote {
            Some(q) if b == q => quote = None,
            Some(_) => {}
            None => match b {
                b'"' | b'\'' => quote = Some(b),
                b'=' => attributes += 1,
                b'x' => namespace |= bytes[i..].starts_with(b"xmlns"),
                b'>' => {
                    let kind = match bytes.get(1) {
                        Some(b'/') => Kind::Close,
                        Some(b'!') => Kind::Other,
                        _ if previous == b'/' => Kind::Other,
                        _ => Kind::Open,
                    };
                    return Tag { kind, attributes, namespace, length: i + 1 };
                }
                _ => {}
            },
        }
        previous = b;
    }
    Tag { kind: Kind::Other, attributes, namespace, length: bytes.len() }
}
