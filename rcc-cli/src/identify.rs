//! What hangs on a wrist sensor, from what it reads in several orientations: mass, centre of mass and the sensor's offset by
//! linear least squares. Pure; the caller's thread.
//!
//! With gravity g turned into the sensor's axes, f = f0 + m g and t = t0 + (m c) × g. Both are linear in the ten unknowns,
//! and without their means (of the readings, of g) the offsets drop out: one number m from the forces, three m c from the
//! torques (Kubus, Kröger and Wahl, "On-line rigid body identification of inertial parameters", IROS 2007, without motion).

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use thiserror::Error;

pub mod readings;

/// Standard gravity (ISO 80000-3), m/s².
pub const GRAVITY: f64 = 9.806_65;
/// Orientations needed: fewer leave nothing to judge the residual by.
pub const ORIENTATIONS_MIN: usize = 6;
/// Two orientations are different if the directions of gravity in the sensor are this far apart, rad.
pub const DIFFERENT_RAD: f64 = 0.0873;
/// The least spread of the directions of gravity, see [`Identified::spread`], that separates the weight from the offset.
pub const SPREAD_MIN: f64 = 0.15;

/// More than this part of the weight left over in the forces is no noise any more.
pub const LEFT_MAX: f64 = 0.1;

/// One reading at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// `[fx fy fz tx ty tz]`, N and N·m, as the sensor says it.
    pub wrench: [f64; 6],
    /// Axes of the sensor in the base, `[x y z w]`, any length but 0.
    pub rotation: [f64; 4],
}

/// What was found, with what it is worth.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Identified {
    /// Of everything behind the sensor, kg.
    pub mass: f64,
    /// Centre of mass, axes and origin of the sensor, m.
    pub centre: [f64; 3],
    /// What the sensor reads without load, N.
    pub force_offset: [f64; 3],
    /// The same, N·m.
    pub torque_offset: [f64; 3],
    /// Readings used.
    pub readings: usize,
    /// Different directions of gravity among them.
    pub orientations: usize,
    /// How different the directions of gravity are: 0 all equal or on one axis, 0.82 evenly from everywhere.
    pub spread: f64,
    /// How much more surely the best known direction of the centre is found than the worst one, 1 at best.
    pub condition: f64,
    /// Root of the mean square of what is left of the force's elements, N, and of the torque's, N·m.
    pub residual: [f64; 2],
    /// Largest element that is left, N and N·m.
    pub residual_max: [f64; 2],
    /// Standard deviation of the mass, kg, and of the worst known direction of the centre, m, if what is left is chance.
    pub deviation: [f64; 2],
}

/// Why nothing can be identified.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum IdentifyError {
    /// A reading is not finite, or its rotation has no direction.
    #[error("reading {number} is not finite, or its rotation is zero")]
    Reading {
        /// Counted from 1.
        number: usize,
    },
    /// Gravity has no direction.
    #[error("gravity must be finite and nonzero")]
    Gravity,
    /// Not enough orientations.
    #[error(
        "{orientations} different orientations among {readings} readings; at least {ORIENTATIONS_MIN} are required: rotate the \
         sensor so that gravity acts along other axes (rotating about the vertical does not help)"
    )]
    TooFew {
        /// Different ones.
        orientations: usize,
        /// Readings.
        readings: usize,
    },
    /// They do not separate the unknowns.
    #[error(
        "the orientations are too similar: their spread is {spread:.3}; at least {SPREAD_MIN} is required to separate weight \
         and offset: let gravity act along all three axes of the sensor, in both directions if possible"
    )]
    TooSimilar {
        /// See [`Identified::spread`].
        spread: f64,
    },
    /// The mass is not above what is left.
    #[error(
        "the estimated mass is {mass:.6} kg with a standard deviation of {deviation:.6} kg: the sensor carries no load, \
         or it does not report the force of the tool on the sensor (negative mass: opposite sign, or inverse rotation)"
    )]
    Mass {
        /// kg.
        mass: f64,
        /// kg.
        deviation: f64,
    },
    /// The readings are not those of one mass on a good sensor.
    #[error(
        "the readings do not fit a single mass: the residual is {left:.2} N for a weight of {weight:.2} N, largest in reading {number} \
         ({most:.2} N): remove that reading if it was disturbed (motion, contact); otherwise the sensor's scale, its axes or \
         the rotations are wrong"
    )]
    Misfit {
        /// Root of the mean square of the force's elements, N.
        left: f64,
        /// N.
        weight: f64,
        /// The reading that fits least, from 1.
        number: usize,
        /// Its largest element, N.
        most: f64,
    },
}

/// Finds the ten parameters of `WrenchCompensation`; `gravity` is the acceleration of what falls, axes of the base, m/s².
///
/// # Errors
/// Readings that are no numbers, too few or too similar orientations, no mass.
pub fn identify(readings: &[Reading], gravity: [f64; 3]) -> Result<Identified, IdentifyError> {
    let down = Vector3::from(gravity);
    if !(down.iter().all(|x| x.is_finite()) && down.norm() > 0.0) {
        return Err(IdentifyError::Gravity);
    }
    let rows = readings.iter().enumerate().map(|(index, reading)| {
        row(reading, down).ok_or(IdentifyError::Reading { number: index + 1 })
    });
    let rows: Vec<Row> = rows.collect::<Result<_, _>>()?;
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

/// Force, torque, and gravity in axes of the sensor.
#[derive(Clone, Copy)]
struct Row {
    force: Vector3<f64>,
    torque: Vector3<f64>,
    gravity: Vector3<f64>,
}

fn row(reading: &Reading, down: Vector3<f64>) -> Option<Row> {
    let [fx, fy, fz, tx, ty, tz] = reading.wrench;
    let unit = rcc_core::rotation::unit(reading.rotation)?;
    let inverse = rcc_core::rotation::inverse(unit);
    let gravity = rcc_core::rotation::rotate(inverse, down.into());
    let finite = reading.wrench.iter().chain(&gravity).all(|x| x.is_finite());
    finite.then(|| Row {
        force: Vector3::new(fx, fy, fz),
        torque: Vector3::new(tx, ty, tz),
        gravity: Vector3::from(gravity),
    })
}

/// How many directions of gravity are further apart than [`DIFFERENT_RAD`].
fn different(rows: &[Row]) -> usize {
    let mut known: Vec<Vector3<f64>> = Vec::new();
    for row in rows {
        let direction = row.gravity.normalize();
        // By the chord: an arc cosine is not exact where it matters.
        let chord = 2.0 * (DIFFERENT_RAD / 2.0).sin();
        if known.iter().all(|one| (one - direction).norm() > chord) {
            known.push(direction);
        }
        // More do not change the answer, and each one costs a look at all readings.
        if known.len() == 100 {
            break;
        }
    }
    known.len()
}

fn fit(rows: &[Row], orientations: usize, fall: f64) -> Result<Identified, IdentifyError> {
    let count = rows.len() as f64;
    let mean = |of: fn(&Row) -> Vector3<f64>| rows.iter().map(of).sum::<Vector3<f64>>() / count;
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
    let left = |row: &Row| {
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
    // So many numbers are free after 4 unknowns of the force, 6 of the torque.
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
    if left_over > LEFT_MAX * weight {
        let off = |row: &Row| left(row)[0].amax();
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
