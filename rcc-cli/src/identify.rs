//! Identifies the load of a wrist sensor from readings in several orientations: mass, centre of mass and the sensor's
//! offsets by linear least squares. Pure; runs on the caller's thread.
//!
//! With gravity g in the sensor's axes, f = f0 + m g and t = t0 + (m c) × g. Both are linear in the ten unknowns.
//! Subtracting the means of the readings and of g eliminates the offsets: m follows from the forces, and the three
//! elements of m c from the torques (Kubus, Kröger and Wahl, "On-line rigid body identification of inertial
//! parameters", IROS 2007, without motion).

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use thiserror::Error;

pub mod readings;

/// Standard gravity (ISO 80000-3), m/s².
pub const GRAVITY: f64 = 9.806_65;
/// Least number of orientations: with fewer, the residual says nothing about the fit.
pub const ORIENTATIONS_MIN: usize = 6;
/// Two orientations count as different if the directions of gravity in the sensor differ by more than this, rad.
pub const ORIENTATION_DIFFERENCE_MIN_RAD: f64 = 0.0873;
/// Least [`Identified::spread`] that separates the weight from the offset.
pub const SPREAD_MIN: f64 = 0.15;

/// Largest residual of the forces, as a part of the weight, that counts as noise.
pub const RESIDUAL_RATIO_MAX: f64 = 0.1;

/// One reading at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// `[fx fy fz tx ty tz]` as reported by the sensor, N and N·m.
    pub wrench: [f64; 6],
    /// Orientation of the sensor in the base frame, `[x y z w]`; any length but 0.
    pub rotation: [f64; 4],
}

/// Identified parameters and their quality.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Identified {
    /// Mass of everything behind the sensor, kg.
    pub mass: f64,
    /// Centre of mass in the sensor's frame, m.
    pub centre: [f64; 3],
    /// Force reading without load, N.
    pub force_offset: [f64; 3],
    /// Torque reading without load, N·m.
    pub torque_offset: [f64; 3],
    /// Number of readings used.
    pub readings: usize,
    /// Number of different directions of gravity among them.
    pub orientations: usize,
    /// Spread of the directions of gravity: 0 if all are equal or on one axis, 0.82 if evenly distributed.
    pub spread: f64,
    /// Condition of the centre of mass: uncertainty of its worst direction relative to its best one; 1 is ideal.
    pub condition: f64,
    /// Root mean square of the residual's elements: force, N, and torque, N·m.
    pub residual: [f64; 2],
    /// Largest element of the residual: force, N, and torque, N·m.
    pub residual_max: [f64; 2],
    /// Standard deviations of the mass, kg, and of the least certain direction of the centre, m, if the residual is
    /// random.
    pub deviation: [f64; 2],
}

/// Reason why the load cannot be identified.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum IdentifyError {
    /// A reading is not finite, or its rotation is zero.
    #[error("reading {number} is not finite, or its rotation is zero")]
    Reading {
        /// Number of the reading, counted from 1.
        number: usize,
    },
    /// Gravity is zero or not finite.
    #[error("gravity must be finite and nonzero")]
    Gravity,
    /// Too few different orientations.
    #[error(
        "{orientations} different orientations among {readings} readings; at least {ORIENTATIONS_MIN} are required: rotate the \
         sensor so that gravity acts along other axes (rotating about the vertical does not help)"
    )]
    TooFew {
        /// Number of different orientations.
        orientations: usize,
        /// Number of readings.
        readings: usize,
    },
    /// The orientations do not separate the unknowns.
    #[error(
        "the orientations are too similar: their spread is {spread:.3}; at least {SPREAD_MIN} is required to separate weight \
         and offset: let gravity act along all three axes of the sensor, in both directions if possible"
    )]
    TooSimilar {
        /// See [`Identified::spread`].
        spread: f64,
    },
    /// The mass is not significant.
    #[error(
        "the estimated mass is {mass:.6} kg with a standard deviation of {deviation:.6} kg: the sensor carries no load, \
         or it does not report the force of the tool on the sensor (negative mass: opposite sign, or inverse rotation)"
    )]
    Mass {
        /// Estimated mass, kg.
        mass: f64,
        /// Its standard deviation, kg.
        deviation: f64,
    },
    /// The readings do not fit one mass on a linear sensor.
    #[error(
        "the readings do not fit a single mass: the residual is {left:.2} N for a weight of {weight:.2} N, largest in reading {number} \
         ({most:.2} N): remove that reading if it was disturbed (motion, contact); otherwise the sensor's scale, its axes or \
         the rotations are wrong"
    )]
    Misfit {
        /// Root mean square of the force residual's elements, N.
        left: f64,
        /// Weight, N.
        weight: f64,
        /// Number of the reading with the largest residual, counted from 1.
        number: usize,
        /// Largest element of its force residual, N.
        most: f64,
    },
}

/// Identifies the ten parameters of `WrenchCompensation`. `gravity` is the acceleration of a falling body in the base
/// frame, m/s².
///
/// # Errors
/// Fails if readings are not finite, if there are too few or too similar orientations, or if no mass is found.
pub fn identify(readings: &[Reading], gravity: [f64; 3]) -> Result<Identified, IdentifyError> {
    let down = Vector3::from(gravity);
    if !(down.iter().all(|x| x.is_finite()) && down.norm() > 0.0) {
        return Err(IdentifyError::Gravity);
    }
    let rows = readings.iter().enumerate().map(|(index, reading)| {
        row(reading, down).ok_or(IdentifyError::Reading { number: index + 1 })
    });
    let rows: Vec<SensorSample> = rows.collect::<Result<_, _>>()?;
    let orientations = different(&rows);
    if orientations < ORIENTATIONS_MIN {
        let readings = rows.len();
        return Err(IdentifyError::TooFew {
            orientations,
            readings,
        });
    }
    fit(&rows, orientations, down.norm())
}

/// One reading: force (N), torque (N·m), and gravity (m/s²), all in the sensor's axes.
#[derive(Clone, Copy)]
struct SensorSample {
    force: Vector3<f64>,
    torque: Vector3<f64>,
    gravity: Vector3<f64>,
}

fn row(reading: &Reading, down: Vector3<f64>) -> Option<SensorSample> {
    let [fx, fy, fz, tx, ty, tz] = reading.wrench;
    let unit = rcc_core::rotation::unit(reading.rotation)?;
    let inverse = rcc_core::rotation::inverse(unit);
    let gravity = rcc_core::rotation::rotate(inverse, down.into());
    let finite = reading.wrench.iter().chain(&gravity).all(|x| x.is_finite());
    finite.then(|| SensorSample {
        force: Vector3::new(fx, fy, fz),
        torque: Vector3::new(tx, ty, tz),
        gravity: Vector3::from(gravity),
    })
}

/// Counts the directions of gravity that differ by more than [`ORIENTATION_DIFFERENCE_MIN_RAD`].
fn different(rows: &[SensorSample]) -> usize {
    let mut known: Vec<Vector3<f64>> = Vec::new();
    for row in rows {
        let direction = row.gravity.normalize();
        // Compares chords, because the arc cosine is inexact for small angles.
        let chord = 2.0 * (ORIENTATION_DIFFERENCE_MIN_RAD / 2.0).sin();
        if known.iter().all(|one| (one - direction).norm() > chord) {
            known.push(direction);
        }
        // A hundred suffice for the answer; each further one would cost a pass over all readings.
        if known.len() == 100 {
            break;
        }
    }
    known.len()
}

fn fit(rows: &[SensorSample], orientations: usize, fall: f64) -> Result<Identified, IdentifyError> {
    let count = rows.len() as f64;
    let mean =
        |of: fn(&SensorSample) -> Vector3<f64>| rows.iter().map(of).sum::<Vector3<f64>>() / count;
    let (force, torque, gravity) = (
        mean(|row| row.force),
        mean(|row| row.torque),
        mean(|row| row.gravity),
    );
    let (mut squares, mut products) = (0.0, 0.0);
    let (mut normal, mut right) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros());
    for row in rows {
        let g = row.gravity - gravity;
        squares += g.norm_squared();
        products += g.dot(&(row.force - force));
        // t = (m c) × g, so that the normal equations are Σ (|g|² - g gᵀ) m c = Σ g × t.
        normal += Matrix3::identity() * g.norm_squared() - g * g.transpose();
        right += g.cross(&(row.torque - torque));
    }
    let eigen = SymmetricEigen::new(normal);
    let (least, most) = (eigen.eigenvalues.min().max(0.0), eigen.eigenvalues.max());
    let spread = (least / count).sqrt() / fall;
    if spread < SPREAD_MIN {
        return Err(IdentifyError::TooSimilar { spread });
    }
    let mass = products / squares;
    let moment = normal
        .lu()
        .solve(&right)
        .ok_or(IdentifyError::TooSimilar { spread })?;
    let force_offset = force - gravity * mass;
    let torque_offset = torque - moment.cross(&gravity);
    let left = |row: &SensorSample| {
        let force = row.force - force_offset - row.gravity * mass;
        [
            force,
            row.torque - torque_offset - moment.cross(&row.gravity),
        ]
    };
    let (mut sums, mut residual_max) = ([0.0; 2], [0.0_f64; 2]);
    for row in rows {
        for ((sum, largest), left) in sums.iter_mut().zip(&mut residual_max).zip(left(row)) {
            *sum += left.norm_squared();
            *largest = largest.max(left.amax());
        }
    }
    let [force_sum, torque_sum] = sums;
    // Degrees of freedom: the force has 4 unknowns, the torque 6.
    let free = [3.0 * count - 4.0, 3.0 * count - 6.0];
    let mass_deviation = (force_sum / free[0] / squares).sqrt();
    if !(mass > 3.0 * mass_deviation && mass > 1e-6) {
        return Err(IdentifyError::Mass {
            mass,
            deviation: mass_deviation,
        });
    }
    let residual = sums.map(|sum| (sum / (3.0 * count)).sqrt());
    let (weight, [left_over, _]) = (mass * fall, residual);
    if left_over > RESIDUAL_RATIO_MAX * weight {
        let off = |row: &SensorSample| left(row)[0].amax();
        let numbered = (1..).zip(rows);
        let worst = numbered.max_by(|(_, a), (_, b)| off(a).total_cmp(&off(b)));
        return Err(IdentifyError::Misfit {
            left: left_over,
            weight,
            number: worst.map_or(0, |(number, _)| number),
            most: residual_max[0],
        });
    }
    Ok(Identified {
        mass,
        centre: (moment / mass).into(),
        force_offset: force_offset.into(),
        torque_offset: torque_offset.into(),
        readings: rows.len(),
        orientations,
        spread,
        condition: (most / least).sqrt(),
        residual,
        residual_max,
        deviation: [mass_deviation, (torque_sum / free[1] / least).sqrt() / mass],
    })
}
