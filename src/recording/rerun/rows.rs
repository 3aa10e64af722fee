//! Distributes the data of a frame over numbers, curves and pictures.

use super::scene::{
    ForceScale, body_entity, force_curves, outline_entity, position_mm, roller_entity, sensors_by_unit, sensors_entity,
};
use super::table::{ComponentValues, EntityTable};
use crate::recording::columns::{ColumnKind, Rows};
use crate::recording::contact_labels::{ContactLabel, close_up_room_m, contact_labels, contacts_page};
use crate::recording::frame::{Frame, Header, Impact, Links};
use crate::recording::view_geometry::{DrawnForce, drawn_forces};
use rerun::{Arrows3D, InstancePoses3D, Points3D, Scalars, TextDocument, Transform3D};

/// The numbers of frames: contacts and rotors of every frame, links and joints with every picture.
pub struct Numbers {
    frame: EntityTable,
    /// Tables that every frame adds to, and tables that every picture adds to, in the order of frames; None: nothing of the drive has a row there.
    often: Vec<Option<EntityTable>>,
    beside_pictures: Vec<Option<EntityTable>>,
}

/// Links and joints are most of a frame, and viewers hold numbers from one row to the next, as they do with pictures.
fn is_beside_pictures(rows: Rows) -> bool {
    match rows {
        Rows::Link | Rows::Joint | Rows::Roller => true,
        Rows::Contact | Rows::Rotor | Rows::Slider | Rows::Touch | Rows::Chamber | Rows::Passage | Rows::Span => false,
    }
}

impl Numbers {
    pub fn new(header: &Header) -> Numbers {
        let empty = Frame::default();
        let (mut often, mut beside_pictures) = (Vec::new(), Vec::new());
        empty.each_table(|table, columns| {
            let names = table.message.columns.iter().map(|column| column.name);
            let columns = names.zip(columns.iter().map(ComponentValues::like)).collect();
            let has_rows = match table.rows {
                Rows::Roller => !header.rollers.is_empty(),
                rows => header.row_paths(rows).is_none_or(|paths| !paths.is_empty()),
            };
            let entity = format!("state/{}", table.message.name);
            let to = if is_beside_pictures(table.rows) { &mut beside_pictures } else { &mut often };
            to.push(has_rows.then(|| EntityTable::numbers(&entity, table.rows.name(), columns)));
        });
        let frame =
            EntityTable::numbers("state/frame", "frame", vec![("state_hash", ComponentValues::U64(Vec::new()))]);
        Numbers { frame, often, beside_pictures }
    }

    pub fn push(&mut self, frame: &Frame) {
        self.frame.u64(0).push(frame.state_hash);
        self.frame.end_row(1);
        let mut tables = self.often.iter_mut();
        frame.each_table(|table, columns| {
            if !is_beside_pictures(table.rows)
                && let Some(Some(table)) = tables.next()
            {
                table.push_row(columns);
            }
        });
    }

    pub fn push_beside_picture(&mut self, frame: &Frame) {
        let mut tables = self.beside_pictures.iter_mut();
        frame.each_table(|table, columns| {
            if is_beside_pictures(table.rows)
                && let Some(Some(table)) = tables.next()
            {
                table.push_row(columns);
            }
        });
    }

    pub fn tables(&mut self) -> impl Iterator<Item = &mut EntityTable> {
        std::iter::once(&mut self.frame).chain(self.often.iter_mut().flatten())
    }

    pub fn tables_beside_pictures(&mut self) -> impl Iterator<Item = &mut EntityTable> {
        self.beside_pictures.iter_mut().flatten()
    }
}

/// Rows of several curves.
pub fn curves_table(entity: &str) -> EntityTable {
    EntityTable::new(entity.into(), vec![(Scalars::descriptor_scalars(), ComponentValues::F64(Vec::new()))])
}

/// A few numbers per frame that a viewer draws over time, several curves per entity.
pub struct Curves {
    contact_force: EntityTable,
    contacts: EntityTable,
    tension: EntityTable,
    speed: EntityTable,
    energy: EntityTable,
    lost: EntityTable,
    error: EntityTable,
    /// Sensors of each unit.
    sensors: Vec<(Vec<usize>, EntityTable)>,
    /// Curve of each body: see [`force_curves`].
    curve_of_body: Vec<usize>,
    /// Largest contact force of each curve in this frame.
    largest_n: Vec<f64>,
}

impl Curves {
    pub fn new(header: &Header) -> Curves {
        let curves = curves_table;
        let (names, curve_of_body) = force_curves(header);
        Curves {
            contact_force: curves("plots/largest_contact_force"),
            contacts: curves("plots/contacts"),
            tension: curves("plots/joint_tension"),
            speed: curves("plots/speed"),
            energy: curves("plots/energy"),
            lost: curves("plots/energy_lost"),
            error: curves("plots/energy_error"),
            sensors: sensors_by_unit(header)
                .into_iter()
                .map(|(unit, sensors)| (sensors, curves(&sensors_entity(&unit))))
                .collect(),
            curve_of_body,
            largest_n: vec![0.0; names.len()],
        }
    }

    /// The curve of contact forces that an impact belongs to.
    pub fn curve_of(&self, impact: &Impact) -> Option<usize> {
        self.curve_of_body.get(impact.body as usize).copied()
    }

    pub fn push(&mut self, frame: &Frame) {
        self.largest_n.fill(0.0);
        for (body, force_n) in frame.contacts.body.iter().zip(&frame.contacts.normal_force_n) {
            if let Some(curve) = self.curve_of_body.get(*body as usize) {
                self.largest_n[*curve] = self.largest_n[*curve].max(*force_n);
            }
        }
        push_curves(&mut self.contact_force, self.largest_n.iter().copied());
        push_curves(&mut self.contacts, [frame.contacts.body.len() as f64]);
        let (mut high, mut low) = (0.0_f64, f64::INFINITY);
        for (x, y) in frame.joints.force_x_n.iter().zip(&frame.joints.force_y_n) {
            let squared = x * x + y * y;
            (high, low) = (high.max(squared), low.min(squared));
        }
        push_curves(&mut self.tension, [high.sqrt(), low.sqrt()]);
        const RPM_PER_RAD_S: f64 = 30.0 / std::f64::consts::PI;
        push_curves(&mut self.speed, frame.rotors.speed_rad_s.iter().map(|w| RPM_PER_RAD_S * w));
        let of = |is_meant: fn(ColumnKind) -> bool| {
            frame.energy.accounts().filter(move |(account, _)| is_meant(account.kind)).map(|(_, value_j)| value_j)
        };
        push_curves(&mut self.energy, of(is_energy_or_work));
        push_curves(&mut self.lost, of(is_lost));
        push_curves(&mut self.error, [frame.energy.error_j]);
        for (sensors, table) in &mut self.sensors {
            push_curves(table, sensors.iter().filter_map(|k| frame.sensors.get(*k).copied()));
        }
    }

    pub fn tables(&mut self) -> impl Iterator<Item = &mut EntityTable> {
        let always = [
            &mut self.contact_force,
            &mut self.contacts,
            &mut self.tension,
            &mut self.speed,
            &mut self.energy,
            &mut self.lost,
            &mut self.error,
        ];
        always.into_iter().chain(self.sensors.iter_mut().map(|(_, table)| table))
    }
}

/// Accounts of the ledger under `plots/energy`.
pub fn is_energy_or_work(kind: ColumnKind) -> bool {
    kind.is_stored() || matches!(kind, ColumnKind::WorkIn | ColumnKind::WorkOut)
}

/// Accounts of the ledger under `plots/energy_lost`.
pub fn is_lost(kind: ColumnKind) -> bool {
    kind == ColumnKind::Lost
}

pub fn push_curves(table: &mut EntityTable, values: impl IntoIterator<Item = f64>) {
    let column = table.f64(0);
    let before = column.len();
    column.extend(values);
    let n = column.len() - before;
    table.end_row(n);
}

/// Where the page of contacts is.
pub const CONTACTS_PAGE: &str = "tables/contacts";

/// The moving parts of the drawing.
pub struct Pictures {
    /// One for each outline of links.
    chain: Vec<EntityTable>,
    links_of_outline: Vec<usize>,
    /// One for each kind of roller, with its radii.
    rollers: Vec<(EntityTable, [f64; 2])>,
    /// One for each body that turns or slides.
    moving: Vec<EntityTable>,
    pins: EntityTable,
    contacts: EntityTable,
    forces: EntityTable,
    friction: EntityTable,
    labels: EntityTable,
    /// All contacts as a page of text.
    page: EntityTable,
}

impl Pictures {
    pub fn new(header: &Header) -> Pictures {
        let vec3 = || ComponentValues::Vec3(Vec::new());
        let quaternion = || ComponentValues::Quaternion(Vec::new());
        let chain = header.link_outlines.iter().map(|outline| {
            let columns = vec![
                (InstancePoses3D::descriptor_translations(), vec3()),
                (InstancePoses3D::descriptor_quaternions(), quaternion()),
            ];
            EntityTable::new(outline_entity(outline), columns)
        });
        let rollers = header.roller_radii().into_iter().enumerate().map(|(kind, radii)| {
            let columns = vec![(InstancePoses3D::descriptor_translations(), vec3())];
            (EntityTable::new(roller_entity(kind), columns), radii)
        });
        let moving = header.bodies.iter().filter(|body| body.moves()).map(|body| {
            let columns = vec![
                (Transform3D::descriptor_translation(), vec3()),
                (Transform3D::descriptor_quaternion(), quaternion()),
            ];
            EntityTable::new(body_entity(body), columns)
        });
        let points = || {
            vec![
                (Points3D::descriptor_positions(), vec3()),
                (Points3D::descriptor_class_ids(), ComponentValues::U16(Vec::new())),
            ]
        };
        let arrows = || vec![(Arrows3D::descriptor_origins(), vec3()), (Arrows3D::descriptor_vectors(), vec3())];
        let text = || ComponentValues::Text(Vec::new());
        let labels = vec![(Points3D::descriptor_positions(), vec3()), (Points3D::descriptor_labels(), text())];
        Pictures {
            chain: chain.collect(),
            links_of_outline: vec![0; header.link_outlines.len()],
            rollers: rollers.collect(),
            moving: moving.collect(),
            pins: EntityTable::new("joints/tension".into(), points()),
            contacts: EntityTable::new("contacts/points".into(), points()),
            forces: EntityTable::new("contacts/forces".into(), arrows()),
            friction: EntityTable::new("contacts/friction".into(), arrows()),
            labels: EntityTable::new("contacts/labels".into(), labels),
            page: EntityTable::new(CONTACTS_PAGE.into(), vec![(TextDocument::descriptor_text(), text())]),
        }
    }

    pub fn push(&mut self, frame: &Frame, header: &Header, scale: ForceScale) {
        self.push_chain(frame, header, scale);
        self.push_rollers(frame, header);
        self.push_bodies(frame, header);
        self.push_forces(frame, scale);
        self.push_words(frame, header, scale);
    }

    fn push_chain(&mut self, frame: &Frame, header: &Header, scale: ForceScale) {
        let Links { x_m, y_m, angle_rad, .. } = &frame.links;
        self.links_of_outline.fill(0);
        for (i, link) in header.links.iter().enumerate().take(x_m.len()) {
            let (s, c) = libm::sincos(0.5 * angle_rad[i]);
            if let Some(table) = self.chain.get_mut(link.outline as usize) {
                table.f32(0).extend_from_slice(&position_mm([x_m[i], y_m[i]], 0.0));
                table.f32(1).extend_from_slice(&[0.0, 0.0, s as f32, c as f32]);
                self.links_of_outline[link.outline as usize] += 1;
            }
            // Front pin: half a pitch ahead of the centre; (c2, s2) is the heading.
            let (c2, s2) = (c * c - s * s, 2.0 * s * c);
            let pin = [x_m[i] + 0.5 * link.pitch_m * c2, y_m[i] + 0.5 * link.pitch_m * s2];
            let (fx, fy) = (frame.joints.force_x_n[i], frame.joints.force_y_n[i]);
            self.pins.f32(0).extend_from_slice(&position_mm(pin, scale.z_mm));
            self.pins.u16(1).push(scale.class((fx * fx + fy * fy).sqrt()));
        }
        for (table, n) in self.chain.iter_mut().zip(&self.links_of_outline) {
            table.end_row(*n);
        }
        self.pins.end_row(header.links.len().min(x_m.len()));
    }

    fn push_rollers(&mut self, frame: &Frame, header: &Header) {
        let places = || frame.rollers.x_m.iter().zip(&frame.rollers.y_m);
        for (table, radii) in &mut self.rollers {
            let mut n = 0;
            for (roller, (x, y)) in header.rollers.iter().zip(places()) {
                if [roller.radius_m, roller.bore_radius_m] == *radii {
                    table.f32(0).extend_from_slice(&position_mm([*x, *y], 0.0));
                    n += 1;
                }
            }
            table.end_row(n);
        }
    }

    fn push_bodies(&mut self, frame: &Frame, header: &Header) {
        let bodies = header.bodies.iter().filter(|body| body.moves());
        for (table, body) in self.moving.iter_mut().zip(bodies) {
            let (origin, angle_rad) = body.pose(frame);
            let (s, c) = libm::sincos(0.5 * angle_rad);
            table.f32(0).extend_from_slice(&position_mm(origin, 0.0));
            table.f32(1).extend_from_slice(&[0.0, 0.0, s as f32, c as f32]);
            table.end_row(1);
        }
    }

    fn push_forces(&mut self, frame: &Frame, scale: ForceScale) {
        let mut n = 0;
        for DrawnForce { point_m, force_n, normal_n, friction_n } in drawn_forces(frame) {
            let point = position_mm(point_m, scale.z_mm);
            self.contacts.f32(0).extend_from_slice(&point);
            self.contacts.u16(1).push(scale.class(normal_n));
            for (table, [fx, fy]) in [(&mut self.forces, force_n), (&mut self.friction, friction_n)] {
                table.f32(0).extend_from_slice(&point);
                table.f32(1).extend_from_slice(&[scale.mm_per_n * fx as f32, scale.mm_per_n * fy as f32, 0.0]);
            }
            n += 1;
        }
        for table in [&mut self.contacts, &mut self.forces, &mut self.friction] {
            table.end_row(n);
        }
    }

    fn push_words(&mut self, frame: &Frame, header: &Header, scale: ForceScale) {
        let labels = contact_labels(frame, header, close_up_room_m(header));
        self.labels.end_row(labels.len());
        for ContactLabel { point_m, text } in labels {
            self.labels.f32(0).extend_from_slice(&position_mm(point_m, scale.z_mm));
            self.labels.text(1).push(text);
        }
        self.page.text(0).push(contacts_page(frame, header));
        self.page.end_row(1);
    }

    pub fn tables(&mut self) -> impl Iterator<Item = &mut EntityTable> {
        let Pictures { chain, links_of_outline: _, rollers, moving, pins, contacts, forces, friction, labels, page } =
            self;
        let others = [pins, contacts, forces, friction, labels, page];
        let rollers = rollers.iter_mut().map(|(table, _)| table);
        chain.iter_mut().chain(rollers).chain(moving).chain(others)
    }
}
