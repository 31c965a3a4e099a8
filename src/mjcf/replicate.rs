//! `replicate`: copies of a part of the body tree, each one step further.

use super::body::{Builder, place};
use super::orientation::{Orientation, Pose};
use super::reader::Reader;
use super::reference::{Space, names};
use crate::spec::Body;

/// A `replicate` whose content is being read.
pub(super) struct Replica {
    /// The element.
    index: usize,
    /// The body around it, and the pose of the frames between.
    body: usize,
    outer: Pose,
    /// How much there was before its content.
    bodies: usize,
    geoms: usize,
    sites: usize,
    cameras: usize,
    lost_geoms: usize,
}

impl Replica {
    /// Notes where the content will start.
    pub fn start(builder: &Builder, index: usize, body: usize, outer: Pose) -> Self {
        let holder = &builder.bodies[body];
        Replica {
            index,
            body,
            outer,
            bodies: builder.bodies.len(),
            geoms: holder.geoms.len(),
            sites: holder.sites.len(),
            cameras: holder.cameras.len(),
            lost_geoms: builder.lost_geoms.len(),
        }
    }

    /// Replaces the content, which is in the coordinates of the replica, by its copies.
    pub fn expand(self, builder: &mut Builder) {
        let element = &builder.tree[self.index];
        let mut reader = Reader::new(element, builder.report);
        reader.required("count");
        let (mut count, mut offset, mut euler) = (1, [0.0; 3], [0.0; 3]);
        reader.integer("count", &mut count);
        reader.list("offset", &mut offset);
        reader.list("euler", &mut euler);
        let separator = reader.text("sep");
        for name in super::schema::IDLE_IN_REPLICATE.split_ascii_whitespace().filter(|name| element.get(name).is_some())
        {
            reader.report.note_on(element, &format!("attribute \"{name}\" has no effect: give offset or euler"));
        }
        let Ok(count) = usize::try_from(count) else {
            return builder.report.error(element, "attribute \"count\": must not be negative", "");
        };

        let last = euler.map(|angle| count as f64 * angle * builder.angles.scale);
        if !last.iter().all(|angle| angle.is_finite()) {
            return builder.report.error(element, "attribute \"euler\": the last copy's angles overflow", "turn less");
        }
        if builder.report.failed() {
            // Copies of what is rejected would only cost time.
            return;
        }

        let bodies = builder.bodies.split_off(self.bodies);
        let holder = &mut builder.bodies[self.body];
        let (geoms, sites) = (holder.geoms.split_off(self.geoms), holder.sites.split_off(self.sites));
        let cameras = holder.cameras.split_off(self.cameras);
        let content = Body { geoms, sites, cameras, ..Body::default() };
        let mut names = names(&bodies, &content);
        let (pairs, excludes) = (builder.pairs.to(&names), builder.excludes.to(&names));
        let tendons = builder.tendons.to(&names);
        let replicated = builder.tendons.names(&tendons);
        names[Space::Tendon as usize] = replicated.iter().map(String::as_str).collect();
        let (equalities, actuators) = (builder.equalities.to(&names), builder.actuators.to(&names));
        let driven = builder.actuators.names(&actuators);
        names[Space::Actuator as usize] = driven.iter().map(String::as_str).collect();
        let sensors = builder.sensors.to(&names);
        let width = count.to_string().len();
        let longer = separator.len() + width;
        let size = weight(&content, longer) + bodies.iter().map(|body| weight(body, longer)).sum::<usize>();
        let lost = builder.lost_geoms[self.lost_geoms..].len();
        let referring =
            pairs.len() + excludes.len() + tendons.len() + equalities.len() + actuators.len() + sensors.len();
        let size = size + referring + lost;
        if !builder.reserve(element, size.saturating_mul(count)) {
            return;
        }

        let suffixes: Vec<String> = (0..count).map(|k| format!("{separator}{k:0width$}")).collect();
        builder.pairs.replicate(&pairs, &names, &suffixes);
        builder.excludes.replicate(&excludes, &names, &suffixes);
        builder.tendons.replicate(&tendons, &names, &suffixes);
        builder.equalities.replicate(&equalities, &names, &suffixes);
        builder.actuators.replicate(&actuators, &names, &suffixes);
        builder.sensors.replicate(&sensors, &names, &suffixes);
        // Pairs may name copies of what is left out.
        let lost = builder.lost_geoms[self.lost_geoms..].iter().filter(|name| !name.is_empty()).cloned();
        let lost: Vec<String> = lost.collect();
        let copies = suffixes.iter().flat_map(|suffix| lost.iter().map(move |name| format!("{name}{suffix}")));
        builder.lost_geoms.extend(copies);
        let mut pos = [0.0; 3];
        for (k, suffix) in suffixes.iter().enumerate() {
            // A copy is turned by a multiple of the angles, which about several axes is no power of one rotation.
            let quat = builder.quat(element, Orientation::Euler(euler.map(|angle| k as f64 * angle)));
            let frame = Pose { pos, quat };
            self.copy(builder, &bodies, &content, self.outer.then(&frame), suffix);
            pos = frame.then(&Pose { pos: offset, ..Pose::IDENTITY }).pos;
        }
    }

    fn copy(&self, builder: &mut Builder, bodies: &[Body], content: &Body, frame: Pose, suffix: &str) {
        let shift = builder.bodies.len() - self.bodies;
        for body in bodies {
            let mut copy = body.clone();
            extend(&mut copy.name, suffix);
            if copy.parent == self.body {
                place(frame, &mut copy.pos, &mut copy.quat);
            } else {
                copy.parent += shift;
            }
            rename(&mut copy, suffix);
            builder.bodies.push(copy);
        }
        let mut copy = content.clone();
        rename(&mut copy, suffix);
        copy.geoms.iter_mut().for_each(|geom| place(frame, &mut geom.pos, &mut geom.quat));
        copy.sites.iter_mut().for_each(|site| place(frame, &mut site.pos, &mut site.quat));
        copy.cameras.iter_mut().for_each(|camera| place(frame, &mut camera.pos, &mut camera.quat));
        let holder = &mut builder.bodies[self.body];
        holder.geoms.append(&mut copy.geoms);
        holder.sites.append(&mut copy.sites);
        holder.cameras.append(&mut copy.cameras);
    }
}

/// What a copy of a body costs: its elements, and a little for long names, which nested replicas make longer.
fn weight(body: &Body, longer: usize) -> usize {
    let names = [&body.name].into_iter();
    let names = names.chain(body.joints.iter().map(|joint| &joint.name));
    let names = names.chain(body.geoms.iter().map(|geom| &geom.name));
    let names = names.chain(body.sites.iter().map(|site| &site.name));
    let names = names.chain(body.cameras.iter().map(|camera| &camera.name));
    names.map(|name| 1 + (name.len() + longer) / 64).sum()
}

fn extend(name: &mut String, suffix: &str) {
    if !name.is_empty() {
        name.push_str(suffix);
    }
}

/// Suffixes the names of what a body holds.
fn rename(body: &mut Body, suffix: &str) {
    body.joints.iter_mut().for_each(|joint| extend(&mut joint.name, suffix));
    body.geoms.iter_mut().for_each(|geom| extend(&mut geom.name, suffix));
    body.sites.iter_mut().for_each(|site| extend(&mut site.name, suffix));
    body.cameras.iter_mut().for_each(|camera| extend(&mut camera.name, suffix));
}
