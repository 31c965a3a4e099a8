//! Pairs of geoms that may touch, and what governs their contacts.

use std::collections::{HashMap, HashSet};

use lanesim_kernels::collision::MOST_OF_FIELD;
use lanesim_kernels::model::{Dof, Geom, HeightField, Hull, NONE, Pair, PairDof, Shape, Sides, Span};

use super::laws::{Contact, Law};
use super::links::Links;
use super::meshes::{Hulls, Meshes};
use super::order::{Placed, Scene};
use super::pose::row_major;
use crate::diagnostics::Diagnostics;
use crate::model::{Names, Surface};
use crate::spec::{self, Source, Spec};

/// Most pairs of a model.
const MAX_PAIRS: usize = 4_000_000;
/// Most entries of the table of pairs' dofs.
const MAX_PAIR_DOFS: usize = 1 << 25;

/// The tables of collision.
#[derive(Default)]
pub(crate) struct Pairs {
    pub geoms: Vec<Geom<f64>>,
    pub hulls: Vec<Hull>,
    pub heights: Vec<HeightField>,
    pub pairs: Vec<Pair<f64>>,
    pub dofs: Vec<PairDof>,
    /// By pair, the geoms whose numbers its contacts mix, if they do.
    pub mixed: Vec<Option<[usize; 2]>>,
    pub nslot: usize,
}

/// Finds the pairs. Problems: too many of them.
pub(crate) fn pairs<'a>(
    spec: &Spec,
    scene: &Scene<'a>,
    links: &Links,
    dofs: &[Dof<f64>],
    body_invweight0: &[[f64; 2]],
    (geom_names, meshes): (&Names, &'a Meshes),
    diagnostics: &mut Diagnostics,
) -> Pairs {
    let mut out = Pairs::default();
    if !spec.option.flags.contact || !spec.option.flags.constraint {
        return out;
    }
    let explicit = explicit(spec, geom_names);
    let replaced: HashSet<(usize, usize)> = explicit.iter().map(|&(a, b, _)| (a, b)).collect();
    let Some(automatic) = automatic(spec, scene, links) else {
        diagnostics.push(
            &Source::default(),
            "contact",
            format!("more than {MAX_PAIRS} pairs of geoms can touch"),
            "separate geoms with contype and conaffinity, or disable contact",
        );
        return out;
    };
    let mut candidates: Vec<(usize, usize, Option<&spec::Pair>)> =
        automatic.into_iter().filter(|pair| !replaced.contains(pair)).map(|(a, b)| (a, b, None)).collect();
    candidates.extend(explicit);
    candidates.sort_by_key(|&(a, b, _)| (a, b));

    let mut table = GeomTable { entry: vec![NONE; scene.geoms.len()], geoms: Vec::new(), hulls: Hulls::new(meshes) };
    let mut chains = Chains::new(dofs, links);
    for (a, b, written) in candidates {
        let (ga, gb) = (&scene.geoms[a], &scene.geoms[b]);
        let ground = |geom: &Placed<spec::Geom>| geom.spec.shape <= spec::Shape::HeightField;
        if ground(ga) && ground(gb) {
            continue;
        }
        let (one, two) = if (ga.spec.shape, a) <= (gb.spec.shape, b) { (a, b) } else { (b, a) };
        let (g1, g2) = (&scene.geoms[one], &scene.geoms[two]);
        let contact = match written {
            Some(pair) => Contact::of(pair),
            None => Contact::mix(&Surface::of(g1.spec), &Surface::of(g2.spec)),
        };
        let contact = contact.overridden(&spec.option);
        let Law { margin, friction, impedance, friction_b } = contact.law(&spec.option);
        let (link1, link2) = (links.moving(g1.body), links.moving(g2.body));
        let Some(Between { dofs, cross, sides }) = chains.between(link1, link2) else {
            diagnostics.push(
                &Source::default(),
                "contact",
                format!("the pairs of moving geoms involve more than {MAX_PAIR_DOFS} degrees of freedom in all"),
                "separate geoms with contype and conaffinity, or exclude bodies",
            );
            return out;
        };
        let slots = slots(g1.spec.shape, g2.spec.shape, spec.option.flags.multiccd);
        let (w1, w2) = (body_invweight0[g1.body], body_invweight0[g2.body]);
        out.pairs.push(Pair {
            geom1: table.entry(scene, links, one, diagnostics),
            geom2: table.entry(scene, links, two, diagnostics),
            link1,
            link2,
            condim: contact.condim as u32,
            slots: Span { start: out.nslot as u32, len: slots as u32 },
            dofs,
            cross,
            sides,
            margin,
            include: contact.margin + contact.gap,
            friction,
            impedance,
            friction_b,
            invweight: w1[0] + w2[0],
        });
        let mixes = written.is_none() && !spec.option.flags.override_;
        out.mixed.push(mixes.then_some([one, two]));
        out.nslot += slots;
    }
    (out.geoms, out.hulls, out.heights) = (table.geoms, table.hulls.hulls, table.hulls.heights);
    out.dofs = chains.list;
    out
}

/// Explicit pairs, geoms in ascending order. Names have been checked.
fn explicit<'a>(spec: &'a Spec, names: &Names) -> Vec<(usize, usize, Option<&'a spec::Pair>)> {
    let resolve = |pair: &'a spec::Pair| {
        let (a, b) = (names.id(&pair.geom1)?, names.id(&pair.geom2)?);
        Some((a.min(b), a.max(b), Some(pair)))
    };
    spec.pairs.iter().filter_map(resolve).collect()
}

/// Geoms of one body with the same masks: what the filters cannot tell apart.
struct Group {
    body: usize,
    contype: u32,
    conaffinity: u32,
    geoms: Vec<usize>,
}

/// Pairs that the filters let through, in ascending order within; `None` if there are too many.
fn automatic(spec: &Spec, scene: &Scene, links: &Links) -> Option<Vec<(usize, usize)>> {
    let weld = weld_groups(scene);
    let excluded = excluded(spec, scene);
    let mut groups: Vec<Group> = Vec::new();
    for (g, geom) in scene.geoms.iter().enumerate() {
        let (contype, conaffinity) = (geom.spec.contype, geom.spec.conaffinity);
        if contype == 0 && conaffinity == 0 {
            continue;
        }
        // A body's geoms are together: look back only as far as its own groups.
        let same = |x: &&mut Group| x.contype == contype && x.conaffinity == conaffinity;
        let own = groups.iter_mut().rev().take_while(|x| x.body == geom.body).find(same);
        match own {
            Some(group) => group.geoms.push(g),
            None => groups.push(Group { body: geom.body, contype, conaffinity, geoms: vec![g] }),
        }
    }
    let moves = |group: &Group| links.moving(group.body) != NONE;
    let (moving, still): (Vec<&Group>, Vec<&Group>) = groups.iter().partition(|g| moves(g));
    let parent_of = |w: usize| weld[scene.bodies[w].parent];
    let allowed = |a: &Group, b: &Group| {
        if (a.contype & b.conaffinity) | (b.contype & a.conaffinity) == 0 {
            return false;
        }
        let (wa, wb) = (weld[a.body], weld[b.body]);
        if wa == wb {
            return false;
        }
        if spec.option.flags.filterparent && wa != 0 && wb != 0 && (wa == parent_of(wb) || wb == parent_of(wa)) {
            return false;
        }
        !excluded.contains(&(a.body.min(b.body), a.body.max(b.body)))
    };
    let mut pairs = Vec::new();
    for (i, a) in moving.iter().enumerate() {
        for b in moving[i + 1..].iter().chain(&still) {
            if !allowed(a, b) {
                continue;
            }
            if pairs.len() + a.geoms.len() * b.geoms.len() > MAX_PAIRS {
                return None;
            }
            for &x in &a.geoms {
                pairs.extend(b.geoms.iter().map(|&y| (x.min(y), x.max(y))));
            }
        }
    }
    Some(pairs)
}

/// The body that leads each body's weld group: the nearest with joints, a mocap body, or the world.
pub(crate) fn weld_groups(scene: &Scene) -> Vec<usize> {
    let mut weld = Vec::with_capacity(scene.bodies.len());
    for (b, body) in scene.bodies.iter().enumerate() {
        let own = b == 0 || !body.joints.is_empty() || body.mocap.is_some();
        weld.push(if own { b } else { weld[body.parent] });
    }
    weld
}

/// Pairs of bodies that an exclude names, in ascending order within.
pub(crate) fn excluded(spec: &Spec, scene: &Scene) -> HashSet<(usize, usize)> {
    exclude_ids(spec, scene).into_iter().collect()
}

/// The bodies of each exclude, in ascending order within.
pub(crate) fn exclude_ids(spec: &Spec, scene: &Scene) -> Vec<(usize, usize)> {
    if spec.excludes.is_empty() {
        return Vec::new();
    }
    let ids: HashMap<&str, usize> =
        scene.bodies.iter().enumerate().map(|(b, body)| (body.spec.name.as_str(), b)).collect();
    let resolve = |e: &spec::Exclude| {
        let (a, b) = (*ids.get(e.body1.as_str())?, *ids.get(e.body2.as_str())?);
        Some((a.min(b), a.max(b)))
    };
    spec.excludes.iter().filter_map(resolve).collect()
}

/// Most contacts of a pair of shapes, the first of which sorts first.
fn slots(one: spec::Shape, two: spec::Shape, multiccd: bool) -> usize {
    use spec::Shape::*;
    match (one, two) {
        (Plane, Capsule) | (Capsule, Capsule) | (Capsule, Box) => 2,
        (Plane, Cylinder | Box | Mesh) => 4,
        (Box, Box) => 8,
        (HeightField, _) => MOST_OF_FIELD,
        (Plane, _) | (Sphere, Sphere | Capsule | Cylinder | Box) => 1,
        _ if multiccd => 5,
        _ => 1,
    }
}

/// The geoms that take part, entered as pairs name them.
struct GeomTable<'a> {
    /// Entry of each MJCF geom, or [`NONE`].
    entry: Vec<u32>,
    geoms: Vec<Geom<f64>>,
    hulls: Hulls<'a>,
}

impl<'a> GeomTable<'a> {
    fn entry(&mut self, scene: &Scene<'a>, links: &Links, id: usize, diagnostics: &mut Diagnostics) -> u32 {
        if self.entry[id] == NONE {
            self.entry[id] = self.geoms.len() as u32;
            let hull = self.hulls.of(scene.geoms[id].spec, id, diagnostics);
            self.geoms.push(Geom { hull, ..geom(&scene.geoms[id], id, links) });
        }
        self.entry[id]
    }
}

/// A shape as the kernels call it.
pub(super) fn shape(shape: spec::Shape) -> Shape {
    match shape {
        spec::Shape::Plane => Shape::Plane,
        spec::Shape::HeightField => Shape::HeightField,
        spec::Shape::Sphere => Shape::Sphere,
        spec::Shape::Capsule => Shape::Capsule,
        spec::Shape::Ellipsoid => Shape::Ellipsoid,
        spec::Shape::Cylinder => Shape::Cylinder,
        spec::Shape::Box => Shape::Box,
        spec::Shape::Mesh => Shape::Mesh,
    }
}

fn geom(geom: &Placed<spec::Geom>, id: usize, links: &Links) -> Geom<f64> {
    let pose = links.body_pose[geom.body].then(&geom.pose);
    let rotation = pose.rotation();
    Geom {
        id: id as u32,
        body: geom.body as u32,
        shape: shape(geom.spec.shape),
        link: links.body_link[geom.body],
        aligned: rotation == glam::DMat3::IDENTITY,
        hull: NONE,
        pos: pose.pos.to_array(),
        rot: row_major(rotation),
        size: geom.spec.size,
        rbound: bounding_radius(geom.spec),
    }
}

/// Radius of the bounding sphere about the geom's centre; 0 for planes.
pub(crate) fn bounding_radius(geom: &spec::Geom) -> f64 {
    let [a, b, c] = geom.size;
    match geom.shape {
        spec::Shape::Plane => 0.0,
        // The third size is half the base and a quarter of the largest height.
        spec::Shape::HeightField => (a * a + b * b + 16.0 * c * c).sqrt(),
        spec::Shape::Sphere => a,
        spec::Shape::Capsule => a + b,
        spec::Shape::Cylinder => (a * a + b * b).sqrt(),
        spec::Shape::Ellipsoid => a.max(b).max(c),
        spec::Shape::Box | spec::Shape::Mesh => (a * a + b * b + c * c).sqrt(),
    }
}

/// The dofs between pairs of links, listed once for each pair of links, or for a link and its ancestors once for all.
struct Chains<'a> {
    dofs: &'a [Dof<f64>],
    links: &'a Links,
    /// What has been listed, by pair of links.
    known: HashMap<(u32, u32), Between>,
    /// Whole chains in the list, by link and sign.
    whole: HashMap<(u32, bool), Span>,
    list: Vec<PairDof>,
}

/// What lies between two links.
#[derive(Clone, Copy)]
struct Between {
    /// Dofs that move one of them and not the other, ascending.
    dofs: Span,
    /// Whether both have some.
    cross: bool,
    /// Which of them moves, and in one tree or not.
    sides: Sides,
}

impl<'a> Chains<'a> {
    fn new(dofs: &'a [Dof<f64>], links: &'a Links) -> Self {
        Chains { dofs, links, known: HashMap::new(), whole: HashMap::new(), list: Vec::new() }
    }

    /// What lies between two links; `None` if the table becomes too long.
    fn between(&mut self, link1: u32, link2: u32) -> Option<Between> {
        if link1 == NONE || link2 == NONE || link1 == link2 {
            return Some(Between { dofs: Span::default(), cross: false, sides: Sides::One });
        }
        if let Some(&known) = self.known.get(&(link1, link2)) {
            return Some(known);
        }
        let start = self.list.len();
        let (mut a, mut b) = (self.links.last_dof(link1), self.links.last_dof(link2));
        let (mut first, mut second) = (false, false);
        // The later of two dofs cannot move the other's link: walk both chains down until they meet.
        while a != b {
            let take_second = a == NONE || (b != NONE && b > a);
            let dof = if take_second { b } else { a };
            self.list.push(PairDof { dof, second: take_second });
            let parent = self.dofs[dof as usize].parent;
            if take_second {
                (b, second) = (parent, true);
            } else {
                (a, first) = (parent, true);
            }
        }
        let len = (self.list.len() - start) as u32;
        let dofs = if first && second {
            self.list[start..].reverse();
            Span { start: start as u32, len }
        } else {
            // One link is an ancestor of the other: what lies between is the end of the latter's chain.
            self.list.truncate(start);
            let chain = self.chain(if second { link2 } else { link1 }, second);
            Span { start: chain.start + chain.len - len, len }
        };
        if self.list.len() > MAX_PAIR_DOFS {
            return None;
        }
        let sides = if a == NONE { Sides::Apart } else { Sides::Two };
        let between = Between { dofs, cross: first && second, sides };
        self.known.insert((link1, link2), between);
        Some(between)
    }

    /// All dofs that move a link, ascending.
    fn chain(&mut self, link: u32, second: bool) -> Span {
        if let Some(&span) = self.whole.get(&(link, second)) {
            return span;
        }
        let start = self.list.len();
        let mut dof = self.links.last_dof(link);
        while dof != NONE {
            self.list.push(PairDof { dof, second });
            dof = self.dofs[dof as usize].parent;
        }
        self.list[start..].reverse();
        let span = Span { start: start as u32, len: (self.list.len() - start) as u32 };
        self.whole.insert((link, second), span);
        span
    }
}
