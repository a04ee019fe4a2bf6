//! Set-points of the arms during a simulation, and panels of them: the path of the flange, and positions, velocities,
//! accelerations and jerks of the joints relative to their limits. Used on the caller's thread.

use rcc_config::CellConfig;
use rcc_core::frame::DeviceModel;
use rcc_core::message::Joints;
use rcc_engine::engine::Engine;

use super::device::SimulatedDevice;
use crate::plot::{PlotCurve, PlotPanel};

/// Set-points of one arm.
#[derive(Clone, Debug)]
struct ArmTrack {
    device: usize,
    name: String,
    joints: Vec<String>,
    model: DeviceModel,
    /// Intervals in which it is commanded: time (s) and set-point (rad) per cycle.
    segments: Vec<Vec<(f64, Joints)>>,
    commanded: bool,
    /// Time (s), force on the flange (N, base axes) and joint torques (N·m), per cycle.
    felt: Vec<(f64, [f64; 3], Joints)>,
}

/// All arms of a cell.
#[derive(Clone, Debug)]
pub struct ArmTracks {
    tracks: Vec<ArmTrack>,
    dt_s: f64,
}

/// Limits are drawn if a value exceeds this part of them, percent.
const LIMITS_SHOWN_PERCENT: f64 = 40.0;
/// Derivatives of the joint positions and their orders, one panel each.
const DERIVATIVES: [(&str, usize); 3] = [("velocity", 1), ("acceleration", 2), ("jerk", 3)];

impl ArmTracks {
    /// Creates empty tracks for the arms of a cell.
    #[must_use]
    pub fn new(config: &CellConfig) -> ArmTracks {
        let arms = config.devices.iter().enumerate();
        let tracks = arms.filter_map(|(device, row)| {
            let robot = row.robot.as_ref()?;
            Some(ArmTrack {
                device,
                name: row.name.clone(),
                joints: robot
                    .joints
                    .iter()
                    .map(|joint| joint.name.clone())
                    .collect(),
                model: row.model(),
                segments: Vec::new(),
                commanded: false,
                felt: Vec::new(),
            })
        });
        ArmTracks {
            tracks: tracks.collect(),
            dt_s: config.period_ns as f64 / 1e9,
        }
    }

    /// Records set-points and measurements of this cycle.
    pub fn record(&mut self, time_s: f64, engine: &Engine, devices: &[SimulatedDevice]) {
        for track in &mut self.tracks {
            if let Some(device) = devices.get(track.device) {
                let m = device.measurement();
                let [fx, fy, fz, ..] = m.wrench;
                track.felt.push((time_s, [fx, fy, fz], m.torque));
            }
            let image = engine.image(track.device);
            let point = image.and_then(|image| image.at(image.head.sequence));
            let point = point.filter(|point| point.has_position == 1);
            if let Some(point) = point {
                if !track.commanded {
                    track.segments.push(Vec::new());
                }
                if let Some(stretch) = track.segments.last_mut() {
                    stretch.push((time_s, point.position));
                }
            }
            track.commanded = point.is_some();
        }
    }

    /// Returns the panels of every commanded arm; `marks` are times of events, s.
    #[must_use]
    pub fn panels(&self, marks: &[f64]) -> Vec<PlotPanel> {
        let commanded = self
            .tracks
            .iter()
            .filter(|track| !track.segments.is_empty());
        let of_several = commanded.clone().count() > 1;
        commanded
            .flat_map(|track| {
                let prefix = if of_several {
                    format!("{}: ", track.name)
                } else {
                    String::new()
                };
                let mut panels = track.panels(self.dt_s);
                for panel in &mut panels {
                    panel.title = format!("{prefix}{}", panel.title);
                    if !panel.is_spatial {
                        panel.marks = marks.to_vec();
                    }
                }
                panels
            })
            .collect()
    }
}

impl ArmTrack {
    fn panels(&self, dt_s: f64) -> Vec<PlotPanel> {
        let mut panels = self.flange_panels(dt_s);
        panels.push(self.positions());
        panels.extend(DERIVATIVES.map(|(name, order)| self.rates(name, order, dt_s)));
        if let Some(force) = self.force() {
            panels.push(force);
            panels.extend(self.torques());
        }
        panels
    }

    /// Returns a panel of the force on the flange; `None` without any contact force.
    fn force(&self) -> Option<PlotPanel> {
        let felt = |(_, force, _): &(f64, [f64; 3], Joints)| force.iter().any(|part| *part != 0.0);
        if !self.felt.iter().any(felt) {
            return None;
        }
        let curve = |(axis, name): (usize, &str)| PlotCurve {
            name: name.to_owned(),
            segments: segments(
                self.felt
                    .iter()
                    .map(|(time_s, force, _)| (*time_s, force[axis])),
            ),
            colour: axis,
        };
        let curves = ["fx", "fy", "fz"].into_iter().enumerate().map(curve);
        let title = "force on the flange [N]".to_owned();
        Some(PlotPanel::over_time(title, curves.collect()))
    }

    /// Returns a panel of the measured joint torques; `None` if the robot's file has no dynamics.
    fn torques(&self) -> Option<PlotPanel> {
        let curve = |(joint, name): (usize, &String)| PlotCurve {
            name: name.clone(),
            segments: segments(
                self.felt
                    .iter()
                    .map(|(time_s, _, torque)| (*time_s, torque[joint])),
            ),
            colour: joint,
        };
        let curves: Vec<PlotCurve> = self.joints.iter().enumerate().map(curve).collect();
        let is_known = curves.iter().any(|curve| !curve.segments.is_empty());
        let title = "measured torque [N·m]".to_owned();
        is_known.then(|| PlotPanel::over_time(title, curves))
    }

    /// Returns panels of the flange's path and speed.
    fn flange_panels(&self, dt_s: f64) -> Vec<PlotPanel> {
        let Some(arm) = self.model.arm else {
            return Vec::new();
        };
        let at = |joints: &Joints| arm.forward(joints).position;
        let positions = |stretch: &Vec<(f64, Joints)>| {
            let positions = stretch.iter().map(|(time_s, joints)| (*time_s, at(joints)));
            positions.collect::<Vec<_>>()
        };
        let path: Vec<Vec<(f64, [f64; 3])>> = self.segments.iter().map(positions).collect();
        let axes = ["x", "y", "z"];
        let projection = |across: usize, up: usize| {
            let stretch = |positions: &Vec<(f64, [f64; 3])>| {
                let points = positions
                    .iter()
                    .map(|(_, position)| (position[across], position[up]));
                points.collect()
            };
            let curve = PlotCurve {
                segments: path.iter().map(stretch).collect(),
                ..PlotCurve::default()
            };
            PlotPanel {
                is_spatial: true,
                across: format!("{} [m]", axes[across]),
                frame: self.model.workspace.map(|space| {
                    [
                        space.lower[across],
                        space.upper[across],
                        space.lower[up],
                        space.upper[up],
                    ]
                }),
                ..PlotPanel::over_time(format!("{} [m], flange", axes[up]), vec![curve])
            }
        };
        let speed = |positions: &Vec<(f64, [f64; 3])>| {
            let pairs = positions.windows(2).map(|pair| {
                let [(_, a), (time_s, b)] = [pair[0], pair[1]];
                let square: f64 = a.iter().zip(b).map(|(a, b)| (b - a) * (b - a)).sum();
                (time_s, square.sqrt() / dt_s)
            });
            pairs.collect()
        };
        let speed = PlotCurve {
            segments: path.iter().map(speed).collect(),
            ..PlotCurve::default()
        };
        let speed = PlotPanel {
            shows: Some([0.0, 0.0]),
            ..PlotPanel::over_time("speed of the flange [m/s]".to_owned(), vec![speed])
        };
        vec![projection(0, 1), projection(0, 2), projection(1, 2), speed]
    }

    /// Returns a panel of the joint positions within their ranges.
    fn positions(&self) -> PlotPanel {
        let limits = self.model.limits;
        let share = |joint: usize, value: f64| {
            let (lower, upper) = (limits.lower[joint], limits.upper[joint]);
            100.0 * (2.0 * value - lower - upper) / (upper - lower)
        };
        let curve = |joint: usize| {
            let stretch = |stretch: &Vec<(f64, Joints)>| {
                let points = stretch
                    .iter()
                    .map(|(time_s, row)| (*time_s, share(joint, row[joint])));
                points.collect()
            };
            self.segments.iter().map(stretch).collect()
        };
        self.joints_panel("position [% of the range from its middle]", curve)
    }

    /// Returns a panel of a derivative of the set-points, relative to its limit.
    fn rates(&self, name: &str, order: usize, dt_s: f64) -> PlotPanel {
        let limits = self.model.limits;
        let limit = [
            limits.velocity_max,
            limits.acceleration_max,
            limits.jerk_max,
        ];
        let limit = limit[order - 1];
        let per = dt_s.powi(order as i32);
        let curve = |joint: usize| {
            let stretch = |stretch: &Vec<(f64, Joints)>| {
                let mut points: Vec<(f64, f64)> = stretch
                    .iter()
                    .map(|(time_s, row)| (*time_s, row[joint]))
                    .collect();
                for _ in 0..order {
                    // Starts from rest: the arm was at the first set-point before.
                    let mut last = points.first().map_or(0.0, |(_, first)| *first);
                    for (_, value) in &mut points {
                        (last, *value) = (*value, *value - last);
                    }
                }
                let scaled = points.into_iter();
                scaled
                    .map(|(time_s, value)| (time_s, 100.0 * value / per / limit[joint]))
                    .collect()
            };
            self.segments.iter().map(stretch).collect()
        };
        let mut panel = self.joints_panel(&format!("{name} [% of the limit]"), curve);
        let values = panel
            .curves
            .iter()
            .flat_map(|curve| curve.segments.iter().flatten());
        let most = values.fold(0.0, |most: f64, (_, value)| most.max(value.abs()));
        if most < LIMITS_SHOWN_PERCENT {
            // Far from the limits: scaled to the values instead.
            panel.limits.clear();
        }
        panel
    }

    fn joints_panel(
        &self,
        title: &str,
        curve: impl Fn(usize) -> Vec<Vec<(f64, f64)>>,
    ) -> PlotPanel {
        let curves = self
            .joints
            .iter()
            .enumerate()
            .map(|(joint, name)| PlotCurve {
                name: name.clone(),
                segments: curve(joint),
                colour: joint,
            });
        PlotPanel {
            limits: vec![-100.0, 100.0],
            ..PlotPanel::over_time(title.to_owned(), curves.collect())
        }
    }
}

/// Splits values at nulls.
fn segments(values: impl Iterator<Item = (f64, f64)>) -> Vec<Vec<(f64, f64)>> {
    let mut segments: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut is_open = false;
    for (time_s, value) in values {
        if value.is_nan() {
            is_open = false;
            continue;
        }
        match segments.last_mut() {
            Some(segment) if is_open => segment.push((time_s, value)),
            _ => segments.push(vec![(time_s, value)]),
        }
        is_open = true;
    }
    segments
}
