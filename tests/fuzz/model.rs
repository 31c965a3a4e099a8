//! MJCF text: small models from a grammar or from the corpus, changed in ways that know the schema, and now and then in
//! ways that do not.

use std::collections::BTreeMap;

use super::random::Random;
use super::schema;

/// An element.
#[derive(Clone, Debug)]
pub struct Node {
    pub tag: String,
    pub attributes: Vec<(String, String)>,
    pub children: Vec<Node>,
}

impl Node {
    fn new(tag: &str) -> Node {
        Node { tag: tag.to_owned(), attributes: Vec::new(), children: Vec::new() }
    }

    fn with(mut self, name: &str, value: impl Into<String>) -> Node {
        self.attributes.push((name.to_owned(), value.into()));
        self
    }

    /// A text as elements; `None` if it is not XML.
    pub fn parse(text: &str) -> Option<Node> {
        fn of(node: roxmltree::Node<'_, '_>) -> Node {
            let attributes = node.attributes().map(|a| (a.name().to_owned(), a.value().to_owned())).collect();
            let children = node.children().filter(roxmltree::Node::is_element).map(of).collect();
            Node { tag: node.tag_name().name().to_owned(), attributes, children }
        }
        Some(of(roxmltree::Document::parse(text).ok()?.root_element()))
    }

    /// Number of elements.
    fn count(&self) -> usize {
        1 + self.children.iter().map(Node::count).sum::<usize>()
    }

    /// Element `index` in the order of the text.
    fn at(&mut self, index: &mut usize) -> Option<&mut Node> {
        if *index == 0 {
            return Some(self);
        }
        *index -= 1;
        self.children.iter_mut().find_map(|child| child.at(index))
    }

    fn any(&mut self, random: &mut Random) -> &mut Node {
        let mut index = random.below(self.count());
        self.at(&mut index).expect("there are so many elements")
    }

    fn write(&self, out: &mut String) {
        out.push('<');
        out.push_str(&self.tag);
        for (name, value) in &self.attributes {
            out.extend([" ", name, "=\""]);
            for c in value.chars() {
                match c {
                    '<' => out.push_str("&lt;"),
                    '&' => out.push_str("&amp;"),
                    '"' => out.push_str("&quot;"),
                    c => out.push(c),
                }
            }
            out.push('"');
        }
        if self.children.is_empty() {
            out.push_str("/>\n");
            return;
        }
        out.push_str(">\n");
        self.children.iter().for_each(|child| child.write(out));
        out.extend(["</", &self.tag, ">\n"]);
    }

    pub fn text(&self) -> String {
        let mut out = String::new();
        self.write(&mut out);
        out
    }
}

/// A number as people, generators and enemies write it.
fn number(random: &mut Random) -> String {
    const ODD: [&str; 34] = [
        "0",
        "-0",
        "nan",
        "inf",
        "-inf",
        "1e300",
        "-1e300",
        "1e-300",
        "5e-324",
        "1e999",
        "1e10",
        "1e5",
        "1e-5",
        "1e-15",
        "4294967296",
        "-2147483649",
        "18446744073709551616",
        "0x10",
        "1,2",
        ".5",
        "5.",
        "+1",
        "1e",
        "--1",
        "١",
        "1f",
        "NaN",
        "Infinity",
        "true",
        "1_000",
        "1e-400",
        "1e308",
        "1e16",
        "1e-160",
    ];
    match random.below(8) {
        0 => (*random.pick(&ODD)).to_owned(),
        1 => format!("{}", random.below(6)),
        2 => format!("{:.3}", -random.unit()),
        _ => format!("{:.3}", random.unit()),
    }
}

fn integer(random: &mut Random) -> String {
    const ODD: [&str; 8] = ["-1", "1000000000", "2147483648", "65536", "1.5", "", "1e9", "300"];
    if random.one_in(10) { (*random.pick(&ODD)).to_owned() } else { format!("{}", random.below(5)) }
}

/// A value of a kind that the schema names.
fn value(kind: &str, random: &mut Random) -> String {
    const TEXTS: [&str; 9] = ["", "a", "b", "x y", "é", "'", "a/b", "\u{0}", "..\\..\\m"];
    if random.one_in(60) {
        return (*random.pick(&TEXTS)).to_owned();
    }
    if let Some(n) = kind.strip_prefix('v').and_then(|n| n.parse::<usize>().ok()) {
        let n = if random.one_in(12) { random.below(n + 3) } else { n };
        let numbers: Vec<String> = (0..n).map(|_| number(random)).collect();
        return numbers.join(if random.one_in(30) { ", " } else { " " });
    }
    match kind {
        "n" => number(random),
        "i" => integer(random),
        "b" => (*random.pick(&["true", "false"])).to_owned(),
        "e" => (*random.pick(&["enable", "disable", "disable", "on"])).to_owned(),
        "f" => (*random.pick(&["a.xml", "b.xml", "none.xml", "../a.xml", "/dev/zero", ""])).to_owned(),
        "t" => (*random.pick(&TEXTS)).to_owned(),
        words if words.contains('|') => {
            let words: Vec<&str> = words.split('|').collect();
            if random.one_in(30) { words[0].to_uppercase() } else { (*random.pick(&words)).to_owned() }
        }
        // A name: few are used, so that references are often right and names often double.
        name => format!("{}{}", name.trim_start_matches('@').to_lowercase(), random.below(4)),
    }
}

/// An attribute of an element, with a value of its kind.
fn attribute(tag: &str, random: &mut Random) -> Option<(String, String)> {
    let rule = schema::rule(tag)?;
    let attributes: Vec<&str> = rule.attributes.split_ascii_whitespace().collect();
    let chosen = if random.one_in(40) {
        random.pick(schema::RULES).attributes.split_ascii_whitespace().next()?
    } else if attributes.is_empty() {
        return None;
    } else {
        *random.pick(&attributes)
    };
    let (name, kind) = chosen.split_once('=')?;
    Some((name.to_owned(), value(kind, random)))
}

/// An element with some attributes and, for a while, children.
fn element(tag: &str, depth: usize, random: &mut Random) -> Node {
    let mut node = Node::new(tag);
    for _ in 0..random.below(4) {
        if let Some((name, value)) = attribute(tag, random)
            && node.attributes.iter().all(|(other, _)| *other != name)
        {
            node.attributes.push((name, value));
        }
    }
    let children: Vec<&str> = schema::rule(tag).map_or("", |rule| rule.children).split_ascii_whitespace().collect();
    if depth > 0 && !children.is_empty() {
        for _ in 0..random.below(3) {
            let child = *random.pick(&children);
            node.children.push(element(child, depth - 1, random));
        }
    }
    node
}

/// A body that a compiler accepts.
fn body(depth: usize, random: &mut Random) -> Node {
    let vector = |random: &mut Random, scale: f64| {
        let x: Vec<String> = (0..3).map(|_| format!("{:.2}", scale * (2.0 * random.unit() - 1.0))).collect();
        x.join(" ")
    };
    let mut node =
        Node::new("body").with("name", format!("body{}", random.below(1000))).with("pos", vector(random, 1.0));
    match random.below(6) {
        0 if depth == 3 => node.children.push(Node::new("freejoint")),
        1 => node.children.push(Node::new("joint").with("type", "ball")),
        2 => node.children.push(Node::new("joint").with("type", "slide").with("axis", vector(random, 1.0))),
        3 => {}
        _ => {
            let joint = Node::new("joint").with("name", format!("joint{}", random.below(1000)));
            node.children.push(joint.with("axis", "0 1 0").with("range", "-30 60").with("damping", "0.1"));
        }
    }
    let kind = *random.pick(&["sphere", "capsule", "box", "ellipsoid", "cylinder"]);
    let geom = Node::new("geom").with("type", kind).with("size", ".1 .1 .1");
    node.children.push(geom.with("condim", *random.pick(&["1", "3", "4", "6"])));
    if random.one_in(3) {
        node.children.push(Node::new("site").with("name", format!("site{}", random.below(1000))));
    }
    if depth > 0 {
        for _ in 0..random.below(3) {
            node.children.push(body(depth - 1, random));
        }
    }
    node
}

/// A small model that loads.
fn sound(random: &mut Random) -> Node {
    let mut root = Node::new("mujoco");
    let mut option = Node::new("option");
    for (name, words) in [
        ("solver", "Newton|CG|PGS"),
        ("cone", "pyramidal|elliptic"),
        ("integrator", "Euler|Euler|RK4|implicitfast|implicit|discrete|midpoint"),
    ] {
        if random.one_in(2) {
            option = option.with(name, value(words, random));
        }
    }
    root.children.push(option);
    let mut world = Node::new("worldbody");
    world.children.push(Node::new("geom").with("type", "plane").with("size", "5 5 .1"));
    for _ in 0..1 + random.below(2) {
        world.children.push(body(3, random));
    }
    let [names, bodies, sites] = ["joint", "body", "site"].map(|tag| {
        let mut names = Vec::new();
        named(&world, tag, &mut names);
        names
    });
    root.children.push(world);
    if random.one_in(2) {
        root.children.push(equality(&[&bodies, &sites, &names], random));
    }
    let mut actuator = Node::new("actuator");
    for name in names.iter().take(3) {
        let tag = *random.pick(&["motor", "position", "velocity", "general"]);
        actuator.children.push(Node::new(tag).with("joint", name.clone()));
    }
    root.children.push(actuator);
    root
}

/// The names of all elements of a tag.
fn named(node: &Node, tag: &str, names: &mut Vec<String>) {
    if node.tag == tag {
        names.extend(node.attributes.iter().find(|(name, _)| name == "name").map(|(_, value)| value.clone()));
    }
    node.children.iter().for_each(|child| named(child, tag, names));
}

/// Equality constraints between bodies, sites and joints of these names; now and then of one with itself.
fn equality(names: &[&Vec<String>; 3], random: &mut Random) -> Node {
    let mut node = Node::new("equality");
    for _ in 0..1 + random.below(3) {
        let (tag, kind) = *random.pick(&[("connect", 0), ("connect", 1), ("weld", 0), ("weld", 1), ("joint", 2)]);
        if names[kind].is_empty() {
            continue;
        }
        let mut row = Node::new(tag);
        for side in 1..=if random.one_in(4) { 1 } else { 2 } {
            row = row.with(&format!("{}{side}", ["body", "site", "joint"][kind]), random.pick(names[kind]).clone());
        }
        if (tag, kind) == ("connect", 0) {
            row = row.with("anchor", ".1 0 -.1");
        }
        for extra in ["active=b", "solref=v2", "torquescale=n", "polycoef=v5"] {
            if random.one_in(6)
                && let Some((name, kind)) = extra.split_once('=')
            {
                row = row.with(name, value(kind, random));
            }
        }
        node.children.push(row);
    }
    node
}

/// A change that knows the schema.
fn change(root: &mut Node, corpus: &[Node], random: &mut Random) {
    let kind = random.below(14);
    let node = root.any(random);
    match kind {
        0..=3 => {
            if let Some((name, value)) = attribute(&node.tag.clone(), random) {
                match node.attributes.iter_mut().find(|(other, _)| *other == name) {
                    Some(old) => old.1 = value,
                    None => node.attributes.push((name, value)),
                }
            }
        }
        4 | 5 if !node.attributes.is_empty() => {
            // Another value for an attribute that is there.
            let place = random.below(node.attributes.len());
            let rule = schema::rule(&node.tag).map_or("", |rule| rule.attributes);
            let name = format!("{}=", node.attributes[place].0);
            let kind = rule.split_ascii_whitespace().find_map(|a| a.strip_prefix(&name)).unwrap_or("n");
            node.attributes[place].1 = value(kind, random);
        }
        6 if !node.attributes.is_empty() => {
            let place = random.below(node.attributes.len());
            node.attributes.remove(place);
        }
        7 if !node.children.is_empty() => {
            let place = random.below(node.children.len());
            node.children.remove(place);
        }
        8 if !node.children.is_empty() => {
            let copy = random.pick(&node.children).clone();
            node.children.push(copy);
        }
        9 => node.children.push(random.pick(corpus).clone().any(random).clone()),
        10 => {
            let tag = if random.one_in(8) { "mujoco" } else { random.pick(schema::RULES).tag };
            let child = element(tag, 2, random);
            node.children.insert(random.below(node.children.len() + 1), child);
        }
        11 => {
            let children: Vec<&str> =
                schema::rule(&node.tag).map_or("", |rule| rule.children).split_ascii_whitespace().collect();
            if !children.is_empty() {
                let child = element(random.pick::<&str>(&children), 2, random);
                node.children.push(child);
            }
        }
        12 => wrap(node, random),
        _ => node.tag = random.pick(schema::RULES).tag.to_owned(),
    }
}

/// Puts what is in an element one level down, or many.
fn wrap(node: &mut Node, random: &mut Random) {
    let depth = if random.one_in(50) { 1 + random.below(400) } else { 1 };
    let tag = *random.pick(&["body", "frame", "replicate", "replicate", "default"]);
    for _ in 0..depth {
        let mut outer = Node::new(tag);
        if tag == "replicate" {
            outer = outer
                .with("count", integer(random))
                .with("offset", value("v3", random))
                .with("euler", value("v3", random));
        }
        outer.children = std::mem::take(&mut node.children);
        node.children.push(outer);
    }
}

/// A change that knows nothing.
fn damage(text: &mut String, random: &mut Random) {
    const PIECES: [&str; 16] = [
        "<",
        ">",
        "/>",
        "\"",
        "<!--",
        "-->",
        "<![CDATA[",
        "]]>",
        "&#0;",
        "&lt;",
        "&a;",
        "<!DOCTYPE a [<!ENTITY b \"bb\">]>",
        "<?xml version=\"1.0\" encoding=\"UTF-16\"?>",
        "\u{feff}",
        " xmlns:a=\"b\"",
        "\u{0}",
    ];
    let places: Vec<usize> = text.char_indices().map(|(i, _)| i).chain([text.len()]).collect();
    let i = random.below(places.len());
    let j = (i + random.below(60)).min(places.len() - 1);
    let (from, to) = (places[i], places[j]);
    match random.below(4) {
        0 => text.truncate(from),
        1 => text.insert_str(from, random.pick::<&str>(&PIECES)),
        2 => text.replace_range(from..to, ""),
        _ => {
            let piece = text[from..to].to_owned();
            text.insert_str(*random.pick(&places), &piece);
        }
    }
}

/// A model's text, and the texts that it may include.
pub struct Model {
    pub text: String,
    pub files: BTreeMap<String, Vec<u8>>,
}

/// A model for an execution.
pub fn model(corpus: &[Node], random: &mut Random) -> Model {
    let mut root = match random.below(4) {
        0 if !corpus.is_empty() => random.pick(corpus).clone(),
        1 => element("mujoco", 5, random),
        _ => sound(random),
    };
    // Often one change only: what is wrong twice is refused for the first.
    let changes = if random.one_in(4) { random.below(12) } else { random.below(3) };
    for _ in 0..changes {
        change(&mut root, corpus, random);
    }
    let mut files = BTreeMap::new();
    if random.one_in(12) {
        root.any(random).children.push(Node::new("include").with("file", "a.xml"));
        let mut part = random.pick(corpus).clone();
        change(&mut part, corpus, random);
        files.insert("a.xml".to_owned(), part.text().into_bytes());
        files.insert("b.xml".to_owned(), "<mujoco><include file=\"a.xml\"/></mujoco>".into());
    }
    let mut text = root.text();
    if random.one_in(10) {
        damage(&mut text, random);
    }
    Model { text, files }
}

/// Options that replace the file's.
pub fn overrides(random: &mut Random) -> Vec<(String, String)> {
    if !random.one_in(6) {
        return Vec::new();
    }
    let tag = *random.pick(&["option", "flag"]);
    (0..1 + random.below(2)).filter_map(|_| attribute(tag, random)).collect()
}
