//! Random nets over the whole catalogue, and random inputs: reproducible from a seed.

use rcc_core::frame::DeviceModel;
use rcc_core::message::{DeviceState, MAGIC, Measurement};
use rcc_core::plan::{Delay, InputPoint, KernelRun, PublishPoint, Rate};
use rcc_core::primitive::{ChannelKind, Operand, PortType, Role, Size, Sizes};
use rcc_core::primitives::{self, CATALOGUE, CatalogueEntry};
use rcc_core::topic::Topic;
use rcc_core::types::{NULL_INT, Store};
use rcc_protocol::control::{InputValue, PlanData};
use rcc_testing::{Random, Rng};

use crate::common::{HOLD, model};

/// Mostly an ordinary number, sometimes NaN or an extreme one.
fn any_real(random: &mut Rng) -> f64 {
    match random.below(12) {
        0 => f64::NAN,
        1 => [0.0, -0.0, 1e300, -1e-300, 1.0][random.below(5)],
        _ => random.uniform(-3.0, 3.0),
    }
}

fn any_int(random: &mut Rng) -> i64 {
    match random.below(8) {
        0 => NULL_INT,
        1 => i64::MAX,
        _ => random.below(20) as i64 - 10,
    }
}

/// Consecutive slots that can be read.
#[derive(Clone, Copy)]
struct Block {
    store: Store,
    slot: u32,
    width: u32,
}

struct RandomPlanBuilder<'a> {
    random: &'a mut Rng,
    models: &'a [DeviceModel],
    data: PlanData,
    blocks: Vec<Block>,
    /// Targets of delayed links whose source is chosen at the end.
    copies: Vec<Block>,
    claimed: Vec<(usize, usize, u32)>,
    arm_taken: bool,
}

/// A net of 3 to 40 random primitives that keeps every rule of `Plan::check`; its start values may not exist.
pub fn net(random: &mut Rng, models: &[DeviceModel], configuration: u64) -> PlanData {
    let data = PlanData {
        catalogue: primitives::fingerprint(),
        configuration,
        survives_device_loss: !random.once_in(3),
        ..PlanData::default()
    };
    let mut builder = RandomPlanBuilder {
        random,
        models,
        data,
        blocks: Vec::new(),
        copies: Vec::new(),
        claimed: Vec::new(),
        arm_taken: false,
    };
    for _ in 0..builder.random.below(4) {
        builder.add_input();
    }
    for _ in 0..3 + builder.random.below(38) {
        builder.add_any();
    }
    builder.add_topics();
    builder.end()
}

impl RandomPlanBuilder<'_> {
    fn add_any(&mut self) {
        let number = self.random.below(CATALOGUE.len());
        let entry = CATALOGUE[number];
        let unwanted = match entry.spec.role {
            Role::Termination => true,
            Role::CommandsArm => self.arm_taken || !self.random.once_in(4),
            // Random numbers define a valid line, but rarely another path that the arm can follow.
            Role::Motion => entry.spec.name != "LinearMotion" || self.data.clocks > 3,
            _ => entry.kernels.is_empty(),
        };
        if !unwanted {
            self.add(number, entry);
        }
    }

    /// A value that is set from outside.
    fn add_input(&mut self) {
        let store = [Store::Real, Store::Bool, Store::Int][self.random.below(3)];
        let width = 1 + self.random.below(9) as u32;
        let block = self.constant(store, width);
        self.blocks.push(block);
        let since = grow(&mut self.data.ints, 1, || NULL_INT);
        let (age, expires) = (self.fresh(Store::Real, 1), self.random.below(30) as u32);
        self.data.inputs.push(InputPoint {
            store,
            slot: block.slot,
            width,
            since,
            age,
            expires,
            at_least: None,
            at_most: None,
            topic: None,
        });
    }

    /// Publishes a block or subscribes to a topic; there are as many topics as kinds of blocks.
    fn add_topics(&mut self) {
        let topic = |block: &Block| {
            let kind = 1 + block.store as u64 * 100 + u64::from(block.width);
            Topic { key: kind, kind }
        };
        let block = self.blocks[self.random.below(self.blocks.len())];
        let own = topic(&block);
        if block.width < 10 && self.random.once_in(2) {
            // One at most: the list must be sorted.
            self.data.publishes.push(PublishPoint {
                topic: own,
                store: block.store,
                slot: block.slot,
                width: block.width,
            });
        }
        for input in &mut self.data.inputs {
            let shown = topic(&Block {
                store: input.store,
                slot: input.slot,
                width: input.width,
            });
            input.topic = (shown != own && self.random.once_in(2)).then_some(shown);
        }
    }

    fn add(&mut self, number: usize, entry: &CatalogueEntry) {
        let kernel = self.random.below(entry.kernels.len());
        let ports = || entry.spec.inputs.iter().chain(entry.spec.outputs);
        let kernel_of = &entry.kernels[kernel];
        let mut sizes = Sizes::ONE;
        for size in entry.spec.sizes(kernel_of).iter() {
            sizes.set(size, 1 + self.random.below(9) as u32);
        }
        if ports().any(|port| port.ty == PortType::Joints) {
            sizes.set(Size::Open, self.models[0].joints);
        }
        let mut operands = Vec::new();
        let mut device = 0;
        for (place, operand) in entry.spec.operands(kernel_of).enumerate() {
            let of_motion = entry.spec.role == Role::Motion && place >= entry.spec.inputs.len();
            operands.push(match operand {
                Operand::Slot {
                    store,
                    width: wide,
                    written,
                } => {
                    let wide = sizes.width(wide);
                    match written {
                        true => self.fresh(store, wide),
                        false if of_motion => self.of_motion(store, wide),
                        false => self.source(store, wide),
                    }
                }
                Operand::Arm => 0,
                Operand::Device => {
                    device = self.random.below(self.models.len());
                    device as u32
                }
                Operand::Channel(kind) => match self.channel(entry.spec.role, kind, device) {
                    Some(channel) => channel,
                    // Only slots that no primitive computes were written.
                    None => return,
                },
                Operand::Clock => {
                    self.data.clocks += 1;
                    self.data.clocks - 1
                }
                Operand::Size(size) => sizes.get(size),
            });
        }
        self.arm_taken |= entry.spec.role == Role::CommandsArm;
        self.run(primitives::kernel_number(number, kernel), &operands);
    }

    fn run(&mut self, kernel: u16, operands: &[u32]) {
        let first = self.data.operands.len() as u32;
        self.data.operands.extend(operands);
        let operands = operands.len() as u32;
        self.data.runs.push(KernelRun {
            kernel,
            first,
            operands,
        });
    }

    fn channel(&mut self, role: Role, kind: ChannelKind, device: usize) -> Option<u32> {
        let count = self.models[device].channels[kind as usize];
        let channel = self.random.below(count as usize) as u32;
        let claim = (device, kind as usize, channel);
        if role == Role::CommandsChannel {
            if self.claimed.contains(&claim) {
                return None;
            }
            self.claimed.push(claim);
        }
        (channel < count).then_some(channel)
    }

    /// New slots that a primitive writes.
    fn fresh(&mut self, store: Store, width: u32) -> u32 {
        let slot = match store {
            Store::Real => grow(&mut self.data.reals, width, || f64::NAN),
            Store::Bool => grow(&mut self.data.bools, width, || 2),
            Store::Int => grow(&mut self.data.ints, width, || 0),
        };
        self.blocks.push(Block { store, slot, width });
        slot
    }

    fn constant(&mut self, store: Store, width: u32) -> Block {
        let random = &mut *self.random;
        let slot = match store {
            Store::Real => grow(&mut self.data.reals, width, || any_real(random)),
            Store::Bool => grow(&mut self.data.bools, width, || random.below(3) as u8),
            Store::Int => grow(&mut self.data.ints, width, || any_int(random)),
        };
        Block { store, slot, width }
    }

    /// The source of an input: a computed value, a delayed link, or a constant.
    fn source(&mut self, store: Store, width: u32) -> u32 {
        let fits = |block: &&Block| block.store == store && block.width >= width;
        let computed: Vec<Block> = self.blocks.iter().filter(fits).copied().collect();
        if !computed.is_empty() && !self.random.once_in(5) {
            let block = computed[self.random.below(computed.len())];
            let room = (block.width - width + 1) as usize;
            return block.slot + self.random.below(room) as u32;
        }
        let block = self.constant(store, width);
        if self.random.once_in(2) {
            self.copies.push(block);
        }
        block.slot
    }

    /// Parameters of a motion: most random ones would be refused.
    fn of_motion(&mut self, store: Store, width: u32) -> u32 {
        match (store, width) {
            (Store::Real, 7) => {
                let mut pose = model().arm.expect("an arm").forward(&HOLD);
                let offset = [(); 3].map(|()| self.random.uniform(-0.05, 0.05));
                for (place, offset) in pose.position.iter_mut().zip(offset) {
                    *place += offset;
                }
                let mut slots = pose.to_slots().into_iter();
                grow(&mut self.data.reals, 7, || slots.next().unwrap_or(0.0))
            }
            (Store::Real, _) => {
                let random = &mut *self.random;
                grow(&mut self.data.reals, width, || random.uniform(0.15, 0.3))
            }
            _ => self.source(store, width),
        }
    }

    fn end(mut self) -> PlanData {
        let done = match self.random.below(3) {
            0 => self.source(Store::Bool, 1),
            _ => grow(&mut self.data.bools, 1, || 0),
        };
        let (number, _) = primitives::find("Termination").expect("it is there");
        self.run(primitives::kernel_number(number, 0), &[done]);
        for copy in std::mem::take(&mut self.copies) {
            let fits = |block: &&Block| block.store == copy.store && block.width >= copy.width;
            let sources: Vec<Block> = self.blocks.iter().filter(fits).copied().collect();
            if !sources.is_empty() {
                self.data.delays.push(Delay {
                    store: copy.store,
                    from: sources[self.random.below(sources.len())].slot,
                    to: copy.slot,
                    width: copy.width,
                });
            }
        }
        if !self.arm_taken && self.random.once_in(4) {
            let every = 1 + self.random.below(5) as u32;
            let phase = self.random.below(every as usize) as u32;
            self.data.rate = Rate { every, phase };
        }
        self.data
    }
}

/// A value for a random input of the net, if it has one.
pub fn value(random: &mut Rng, inputs: &[InputPoint]) -> Option<InputValue> {
    let input = random.below(inputs.len());
    let point = inputs.get(input)?;
    let word = |_| match point.store {
        Store::Real => any_real(random).to_bits(),
        Store::Bool => random.below(3) as u64,
        Store::Int => any_int(random).cast_unsigned(),
    };
    Some(InputValue {
        input: input as u32,
        words: (0..point.width).map(word).collect(),
    })
}

fn grow<T>(arena: &mut Vec<T>, width: u32, mut value: impl FnMut() -> T) -> u32 {
    let slot = arena.len() as u32;
    arena.extend((0..width).map(|_| value()));
    slot
}

/// Changes measurements as real devices do, and slightly more.
pub fn measure(random: &mut Rng, measurement: &mut Measurement) {
    measurement.magic = MAGIC;
    for group in [
        &mut measurement.position[..],
        &mut measurement.torque,
        &mut measurement.external_torque,
        &mut measurement.wrench,
        &mut measurement.analog,
    ] {
        for value in group {
            if random.once_in(3) {
                *value = any_real(random);
            }
        }
    }
    measurement.digital = random.bits();
    measurement.digital_known = random.bits() | random.bits();
    if random.once_in(100) {
        measurement.state = DeviceState::Online as u32;
    }
}
