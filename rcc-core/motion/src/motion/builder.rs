//! Builds the motions of a net: plans their paths, and what follows a leg that `until` may end. Run when a command is
//! made ready; allocates.

use rcc_core::frame::{DeviceModel, PrepareFault, arm_at_rest};
use rcc_core::message::Joints;
use rcc_core::path::{LEGS_MAX, Leg, MotionBuilder, MotionFault, PathLimits, PathRequest};

use super::{LegProgress, Motion, MotionSet};
use crate::after_until::LegAfterUntil;
use crate::path_clock::{PathBounds, PathClock};
use crate::planned_path::{ArmStart, LegFault, MotionSection, build};

/// Builds the motions of one net.
#[derive(Debug)]
pub struct MotionSetBuilder<'a> {
    models: &'a [DeviceModel],
    holds: &'a [Option<Joints>],
    dt_s: f64,
    motions: Vec<Option<Motion>>,
}

impl<'a> MotionSetBuilder<'a> {
    /// A builder for a net of `count` motions that is evaluated every `dt_s` (s), with arms at rest at `holds` (rad, by
    /// device; `None`: not known).
    #[must_use]
    pub fn new(
        models: &'a [DeviceModel],
        holds: &'a [Option<Joints>],
        dt_s: f64,
        count: u32,
    ) -> MotionSetBuilder<'a> {
        MotionSetBuilder {
            models,
            holds,
            dt_s,
            motions: vec![None; count as usize],
        }
    }

    /// Returns all motions.
    ///
    /// # Errors
    /// [`PrepareFault::Motion`] if a motion was not requested by any primitive.
    pub fn finish(self) -> Result<MotionSet, PrepareFault> {
        let motions = self.motions.into_iter().zip(0..);
        let motions = motions.map(|(built, motion)| {
            built.ok_or(PrepareFault::Motion {
                motion,
                leg: 0,
                fault: MotionFault::NoMotion,
            })
        });
        Ok(MotionSet(motions.collect::<Result<_, _>>()?))
    }
}

impl MotionSetBuilder<'_> {
    fn motion(&self, request: &PathRequest<'_>) -> Result<Motion, MotionBuildFault> {
        let count = request.legs.len();
        if count == 0 || count > LEGS_MAX {
            let count = u32::try_from(count).unwrap_or(u32::MAX);
            return Err((0, MotionFault::Legs { count }).into());
        }
        let (arm, hold) = arm_at_rest(self.models, self.holds, request.device)?;
        let model = self.models.get(request.device as usize);
        let model = model.ok_or((0, MotionFault::NoMotion))?;
        let arm_start = ArmStart::starting(model, arm, hold, request.from);
        let arm_start = arm_start.map_err(|fault| (0, fault))?;
        let built = build(arm_start, (request.legs, request.pace), self.dt_s)?;
        let (planned_path, mut sections) = built;
        conditions(&mut sections, request.legs)?;
        for number in 1..sections.len() {
            if sections[number - 1].until.is_none() {
                continue;
            }
            let made = LegAfterUntil::new(
                (model, arm),
                request.legs,
                (&planned_path, &sections),
                number,
                self.dt_s,
            )?;
            sections[number].after_until = Some(Box::new(made));
        }
        let last = sections.last();
        Ok(Motion {
            length: last.map_or(0.0, |section| section.begin + section.length),
            planned_path: Box::new(planned_path),
            sections,
            section: 0,
            clock: PathClock::new(),
            braking: None,
            progress: LegProgress::default(),
            line: None,
            line_bounds: line_bounds(self.dt_s)?,
        })
    }
}

/// Bounds with room for those of a line from rest.
fn line_bounds(dt_s: f64) -> Result<PathBounds, LegFault> {
    let limits = PathLimits {
        length: 0.0,
        velocity: 1.0,
        acceleration: 1.0,
        jerk: 1.0,
    };
    PathBounds::of_limits(&limits, dt_s).map_err(|_| (0, MotionFault::NotFinite))
}

/// Assigns the conditions of the legs to the sections that they begin or end.
///
/// # Errors
/// Returns [`MotionFault::NotAtRest`] if the motion does not rest before a leg with `wait`, or after one with `until`.
fn conditions(sections: &mut [MotionSection], legs: &[Leg<'_>]) -> Result<(), LegFault> {
    for section in &mut *sections {
        let [first, last] = section.legs.map(|leg| legs.get(leg as usize));
        section.wait = first.and_then(|leg| leg.wait);
        section.until = last.and_then(|leg| leg.until);
    }
    for (leg, number) in legs.iter().zip(0..) {
        let mut all = sections.iter();
        let mut begins = || all.any(|section| section.legs[0] == number);
        let waits = leg.wait.is_none() || begins();
        let mut all = sections.iter();
        let mut ends = || all.any(|section| section.legs[1] == number);
        if !(waits && (leg.until.is_none() || ends())) {
            return Err((number, MotionFault::NotAtRest));
        }
    }
    Ok(())
}

/// Why a motion cannot be built.
enum MotionBuildFault {
    /// The arm or its hold set-point is not available.
    Arm(PrepareFault),
    /// Index of the leg and its fault.
    Leg(u32, MotionFault),
}

impl From<PrepareFault> for MotionBuildFault {
    fn from(fault: PrepareFault) -> Self {
        Self::Arm(fault)
    }
}

impl From<(u32, MotionFault)> for MotionBuildFault {
    fn from((leg, fault): (u32, MotionFault)) -> Self {
        Self::Leg(leg, fault)
    }
}

impl MotionBuilder for MotionSetBuilder<'_> {
    fn path(&mut self, index: u32, request: &PathRequest<'_>) -> Result<(), PrepareFault> {
        let fault = |leg, fault| PrepareFault::Motion {
            motion: index,
            leg,
            fault,
        };
        let motion = self.motion(request).map_err(|error| match error {
            MotionBuildFault::Arm(error) => error,
            MotionBuildFault::Leg(leg, error) => fault(leg, error),
        })?;
        let point = self.motions.get_mut(index as usize);
        *point.ok_or(fault(0, MotionFault::NoMotion))? = Some(motion);
        Ok(())
    }
}
