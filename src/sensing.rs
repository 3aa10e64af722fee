//! Sensor readings of a drive with link bodies at a node: after `evaluate`, before `advance`.

use crate::assemble::{Assembly, AssemblyError, assemble};
use crate::drive::Drive;
use crate::drive::sensors::SensorReads;
use crate::elements::driver_motion::DriverMotion;
use crate::elements::span::ChainSpan;
use crate::integrate::explicit::{self, ContactGroup, Scratch};
use crate::integrate::{StepError, scheme};
use crate::model::Model;
use crate::pairs::part_part::TouchShape;
use crate::state::State;

/// The tension of a span is that of its joints within this distance of its middle, in pitches.
const SPAN_WINDOW_PITCHES: f64 = 2.0;

/// True value in SI.
pub fn read(model: &Model, state: &State, scratch: &Scratch, reads: SensorReads) -> f64 {
    let r = &state.coordinates;
    let of = |part: usize| model.turning_part(part);
    match reads {
        SensorReads::Angle(k) => r.angle[of(k)],
        SensorReads::Speed(k) => r.omega[of(k)] + 0.5 * model.step_s * scratch.coordinate_alpha()[of(k)],
        SensorReads::Acceleration(k) => scratch.coordinate_alpha()[of(k)],
        SensorReads::Torque(k) => -scratch.chain_torque()[of(k)] - scratch.parts_force()[of(k)],
        SensorReads::Span(k) => span_tension(model, state, scratch, k),
        SensorReads::Link(i) => {
            let i = model.chain.lane_of(i % model.chain.n_links);
            0.5 * (along(state, scratch, i, i) + along(state, scratch, i, model.chain.previous(i)))
        }
        SensorReads::Guide(k) => guide_force(model, scratch, k),
        SensorReads::Slider(k) => r.angle[model.sliders[k].coordinate],
        SensorReads::Valve(k) => model.cams().nth(k).map_or(f64::NAN, |cam| r.angle[cam.valve]),
        SensorReads::Twist(k) => {
            model.free_ends.get(k).map_or(f64::NAN, |end| end.iter().map(|(q, weight)| weight * r.angle[*q]).sum())
        }
        SensorReads::Tip(k) => {
            let is_tip =
                |s: &TouchShape| matches!(s, TouchShape::Tip { slider, .. } if *slider == model.sliders[k].coordinate);
            let touch = model.touches.iter().position(|t| is_tip(&t.shape));
            touch.map_or(f64::NAN, |i| explicit::touches::normal_force(scratch, i))
        }
        SensorReads::Pressure(k) => state.oil.pressure_pa[k],
        SensorReads::Flow(k) => {
            let speed = |q: usize| r.omega[q] + 0.5 * model.step_s * scratch.coordinate_alpha()[q];
            model.oil.as_ref().map_or(f64::NAN, |oil| oil.flow_m3_s(k, &r.angle, &speed, &state.oil))
        }
    }
}

/// Force of joint `j` along the heading of link `i`.
fn along(state: &State, scratch: &Scratch, i: usize, j: usize) -> f64 {
    let (x, y, _) = scratch.joint_force(j);
    -(x * state.links.cos[i] + y * state.links.sin[i])
}

/// Tension in the middle of the span that leaves sprocket `k`: a mean over nearby joints, with weights that decrease
/// with distance.
fn span_tension(model: &Model, state: &State, scratch: &Scratch, k: usize) -> f64 {
    let of_chain = |s: &&ChainSpan| s.sprockets[0] == k;
    if let Some(span) = model.spans.iter().find(of_chain) {
        return explicit::shafts::span_at(model, state, span).tension_n;
    }
    let Some((route, place)) = model.route_at(k) else { return f64::NAN };
    let span = route.span_after(place);
    let middle = span.start + span.direction * (0.5 * span.length_m);
    let (mut sum, mut weights) = (0.0, 0.0);
    for i in model.chain.loops[model.sprockets[k].chain].clone() {
        let reach = 2.0 * model.chain.lever[i] * SPAN_WINDOW_PITCHES;
        let lever = model.chain.lever[i];
        let front = crate::geometry::Vec2::new(
            state.links.x[i] + lever * state.links.cos[i] - middle.x,
            state.links.y[i] + lever * state.links.sin[i] - middle.y,
        );
        let away = front.dot(&span.direction).abs();
        let aside = crate::geometry::cross(span.direction, front).abs();
        let weight = 1.0 - away / reach;
        if weight > 0.0 && aside < reach {
            let (x, y, _) = scratch.joint_force(i);
            // The force on the link ahead points backwards.
            sum -= weight * (x * span.direction.x + y * span.direction.y);
            weights += weight;
        }
    }
    if weights > 0.0 { sum / weights } else { 0.0 }
}

fn guide_force(model: &Model, scratch: &Scratch, k: usize) -> f64 {
    let mut sum = 0.0;
    let body = model.sprockets.len() + k;
    for part in ContactGroup::in_model(model)
        .into_iter()
        .filter(|p| p.touches(model, body) && !matches!(p, ContactGroup::Bushes))
    {
        let memory = scratch.memory(part);
        for lane in model.chain.links() {
            if memory.normal_force[lane] != 0.0 && scratch.partner(model, part, lane).is_some_and(|(b, _)| b == body) {
                sum += memory.normal_force[lane];
            }
        }
    }
    sum
}

/// Runs a drive and records its sensors continuously, without gains and signal effects.
pub struct Tracer {
    drive: Drive,
    model: Model,
    state: State,
    scratch: Scratch,
    stride: u64,
    /// One series for every sensor, SI.
    readings: Vec<Vec<f64>>,
}

impl Tracer {
    /// Assembles a drive, to be read at intervals of at most `every_s` seconds.
    pub fn new(drive: &Drive, every_s: f64) -> Result<Tracer, AssemblyError> {
        let Assembly { model, state, .. } = assemble(drive)?;
        let stride = (every_s / model.step_s * (1.0 + 1e-9)).floor().max(1.0) as u64;
        let readings = vec![Vec::new(); drive.sensors.len()];
        Ok(Tracer { drive: drive.clone(), scratch: Scratch::new(&model), model, state, stride, readings })
    }

    /// Time between two readings [s].
    pub fn step_s(&self) -> f64 {
        self.model.step_s * self.stride as f64
    }

    pub fn readings(&self, sensor: usize) -> &[f64] {
        &self.readings[sensor]
    }

    /// Speed of a sprocket at the nominal chain speed [rad/s].
    pub fn nominal_speed(&self, sprocket: usize) -> f64 {
        self.model.coordinates[self.model.turning_part(sprocket)].nominal_speed_rad_s
    }

    /// By how much time the driver is ahead in the mean over `period_s` of where it would stand without effects on its speed [s]. Before the first
    /// reading.
    pub fn driver_lead_s(&self, period_s: f64) -> f64 {
        let (model, run) = (&self.model, &self.drive.run);
        let driver = model.sprockets[model.driver].coordinate;
        let before_s = run.run_in_s + run.settle_s;
        let lead = |motion: &DriverMotion| motion.mean_lead_s(self.state.coordinates.angle[driver], before_s, period_s);
        model.driver_motion.as_ref().map_or(0.0, lead)
    }

    /// Discards all readings.
    pub fn clear_readings(&mut self) {
        self.readings.iter_mut().for_each(Vec::clear);
    }

    /// Runs until readings cover this time.
    pub fn run_until(&mut self, covered_s: f64) -> Result<(), StepError> {
        let wanted = libm::ceil(covered_s / self.step_s()) as usize + 1;
        let have = self.readings.first().map_or(0, Vec::len);
        self.read_on(wanted.saturating_sub(have))
    }

    /// Continues the run for so many readings.
    pub fn read_on(&mut self, readings: usize) -> Result<(), StepError> {
        for _ in 0..readings {
            for k in 0..self.stride {
                scheme::evaluate(&self.model, &self.state, &mut self.scratch)?;
                if k == 0 {
                    for (series, sensor) in self.readings.iter_mut().zip(&self.drive.sensors) {
                        series.push(read(&self.model, &self.state, &self.scratch, sensor.reads));
                    }
                }
                scheme::advance(&self.model, &mut self.state, &mut self.scratch);
            }
        }
        Ok(())
    }

    /// Continues the run for this time.
    pub fn run_for(&mut self, duration_s: f64) -> Result<(), StepError> {
        let have = self.readings.first().map_or(0, Vec::len);
        self.run_until(have as f64 * self.step_s() + duration_s)
    }
}
