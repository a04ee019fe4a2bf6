//! Arbitrary bytes as messages: nothing panics, memory stays proportional to the bytes received, and accepted messages
//! can be encoded again. A single thread, whose heap is measured.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fmt::Debug;

use rcc_core::plan::{Rate, ValuePoint};
use rcc_core::types::Store;
use rcc_protocol::control::{Answer, Call, InputValue, NetValues, PlanData, Refusal};
use rcc_protocol::wire::{Message, decode, encode};
use rcc_testing::Rng;

/// Measures the heap of a thread.
struct Measuring;

thread_local! {
    /// Bytes in use now, and the maximum since the last reset.
    static HEAP: Cell<(usize, usize)> = const { Cell::new((0, 0)) };
}

fn taken(size: usize) {
    // While the thread ends, nothing is measured.
    let _ = HEAP.try_with(|heap| {
        let (now, most) = heap.get();
        let now = now.saturating_add(size);
        heap.set((now, most.max(now)));
    });
}

fn given_back(size: usize) {
    let _ = HEAP.try_with(|heap| {
        let (now, most) = heap.get();
        heap.set((now.saturating_sub(size), most));
    });
}

#[allow(unsafe_code)]
// SAFETY: every call is passed on to the system allocator; measuring allocates nothing.
unsafe impl GlobalAlloc for Measuring {
    // SAFETY: the caller's guarantees are passed on.
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        taken(layout.size());
        // SAFETY: as above.
        unsafe { System.alloc(layout) }
    }
    // SAFETY: the caller's guarantees are passed on.
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        given_back(layout.size());
        // SAFETY: as above.
        unsafe { System.dealloc(memory, layout) }
    }
    // SAFETY: the caller's guarantees are passed on.
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Old and new block may both exist for a moment.
        taken(size);
        given_back(layout.size());
        // SAFETY: as above.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Measuring = Measuring;

/// Returns the maximum number of bytes that `work` had in use at a time.
fn most(work: impl FnOnce()) -> usize {
    let (before, _) = HEAP.with(Cell::get);
    HEAP.with(|heap| heap.set((before, before)));
    work();
    HEAP.with(Cell::get).1 - before
}

/// serde reserves this much of a list before its elements arrive.
const AHEAD: usize = 1 << 20;
/// Nested lists in a message.
const NESTED: usize = 2;
/// Bytes of memory per byte of a message: an empty list within a list takes one byte encoded and 32 decoded, and a
/// growing list exists twice for a moment, once with double capacity.
const GROWTH: usize = 32 * 3;

fn try_it<T: Message + Debug>(bytes: &[u8]) -> bool {
    let mut accepted = false;
    let used = most(|| {
        if let Ok(message) = decode::<T>(bytes) {
            accepted = true;
            drop(message);
        }
    });
    let allowed = AHEAD * NESTED + GROWTH * bytes.len() + 4096;
    assert!(used <= allowed, "{used} bytes for {bytes:?}");
    if accepted {
        let again = |bytes: &[u8]| decode::<T>(bytes).ok().and_then(|one| encode(&one).ok());
        let once = again(bytes).expect("what was accepted can be sent");
        assert_eq!(again(&once), Some(once.clone()), "{bytes:?}");
    }
    accepted
}

fn calls() -> Vec<Vec<u8>> {
    let point = ValuePoint {
        store: Store::Real,
        slot: 3,
        width: 7,
    };
    let plan = PlanData {
        catalogue: u64::MAX,
        reals: vec![0.5; 20],
        bools: vec![1; 9],
        ints: vec![i64::MIN, -1, 1 << 40],
        operands: (0..300).collect(),
        clocks: 1,
        rate: Rate::default(),
        ..PlanData::default()
    };
    let value = |words: &[u64]| InputValue {
        input: 1,
        words: words.to_vec(),
    };
    let all = [
        Call::Reserve,
        Call::Install { id: 1, plan },
        Call::Start {
            id: u64::MAX,
            lease: 3,
        },
        Call::Switch {
            stop: vec![1, 2],
            start: vec![3],
            lease: 4,
        },
        Call::Set {
            id: 4,
            values: vec![value(&[0, u64::MAX]), value(&[]), value(&[7])],
        },
        Call::Read {
            id: 5,
            points: vec![point; 4],
        },
        Call::Acknowledge,
    ];
    all.iter()
        .map(|call| encode(call).expect("a call"))
        .collect()
}

fn answers() -> Vec<Vec<u8>> {
    let values = NetValues {
        cycle: 1 << 40,
        words: (0..40).collect(),
        ..NetValues::default()
    };
    let refusal = Refusal::FirstSetPoint {
        device: 1,
        joint: 2,
        value: 0.1,
        limit: f64::NAN,
        violation: 3,
    };
    let all = [
        Answer::Reserved { id: 7 },
        Answer::Done { cycle: 300 },
        Answer::Values(values),
        Answer::Refused(Refusal::NotUnderstood),
        Answer::RefusedFor { id: 9, refusal },
    ];
    all.iter()
        .map(|one| encode(one).expect("an answer"))
        .collect()
}

/// Length prefixes: 251 to 254 are followed by an integer of two to sixteen bytes.
const HUGE: [&[u8]; 5] = [
    &[251, 255, 255],
    &[252, 255, 255, 255, 15],
    &[253, 255, 255, 255, 255, 255, 255, 255, 127],
    &[253, 0, 0, 0, 0, 0, 1, 0, 0],
    &[254],
];

fn of_any_kind<T: Message + Debug>(samples: &[Vec<u8>], seed: u64) {
    let mut chance = Rng::with_seed(seed);
    println!("seed {seed:#x}");
    for sample in samples {
        assert!(try_it::<T>(sample), "a sample is accepted");
        for end in 0..sample.len() {
            assert!(!try_it::<T>(&sample[..end]), "cut after {end}");
            for huge in HUGE {
                // Replacing a byte, and inserted between two.
                try_it::<T>(&[&sample[..end], huge].concat());
                try_it::<T>(&[&sample[..end], huge, &sample[end..]].concat());
                try_it::<T>(&[&sample[..end], huge, &sample[end + 1..]].concat());
            }
        }
        assert!(!try_it::<T>(&[&sample[..], &[0]].concat()), "one more");
        for _ in 0..2000 {
            let mut changed = sample.clone();
            for _ in 0..=chance.usize(..3) {
                let at = chance.usize(..changed.len());
                changed[at] = chance.u8(..);
            }
            try_it::<T>(&changed);
        }
    }
    for _ in 0..5000 {
        let length = chance.usize(..600);
        let mut bytes: Vec<u8> = (0..length).map(|_| chance.u8(..)).collect();
        if let Some(first) = bytes.first_mut() {
            *first %= 16;
        }
        try_it::<T>(&bytes);
    }
    // Messages of maximum length filled with one byte.
    for byte in [0, 1, 250, 251, 252, 253, 255] {
        for first in 0..14 {
            let mut bytes = vec![byte; T::BYTES_MAX.min(1 << 18)];
            bytes[0] = first;
            try_it::<T>(&bytes);
        }
    }
    assert!(decode::<T>(&vec![0; T::BYTES_MAX + 1]).is_err());
}

#[test]
fn bytes_of_any_kind_are_calls_or_refused() {
    of_any_kind::<Call>(&calls(), 0x9e37_79b9_7f4a_7c15);
}

#[test]
fn bytes_of_any_kind_are_answers_or_refused() {
    of_any_kind::<Answer>(&answers(), 0x2545_f491_4f6c_dd1d);
}
