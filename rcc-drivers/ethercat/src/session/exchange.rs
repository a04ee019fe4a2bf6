//! The exchanges of a session, once a period, and the judgement of each answer.
//! Run by the thread of the session.

use std::time::{Duration, Instant};

use async_io::Timer;
use ethercrab::error::Error;
use ethercrab::subdevice_group::{CycleInfo, HasDc, HasPdi, NoDc, Op, SafeOp};
use ethercrab::{AlStatusCode, Command, MainDevice, RegisterAddress, SubDeviceState, TxRxResponse};
use futures_lite::future;

use super::start::{self, Group, StartedLine};
use super::{
    Application, Cycle, Loss, PortErrors, STATE_CHANGE, SessionError, SessionOptions,
    TERMINALS_MAX, TerminalImage,
};

/// Longest time until an application that must end is noticed while the line starts.
const END_STEP: Duration = Duration::from_millis(10);
/// At the end, time for the terminals to switch their outputs off by themselves.
const SWITCH_OFF: Duration = Duration::from_millis(200);
/// Time without a complete exchange after which a terminal that does not answer may have been without power.
const POWER_LOST: Duration = Duration::from_millis(300);
/// Time between two readings of error counters, of one terminal after the other.
const ERRORS_EVERY: Duration = Duration::from_millis(250);

/// A line whose process data are exchanged, with distributed clocks or without.
trait ExchangingGroup {
    /// Content of an answer beyond working counter and states.
    type Extra;

    /// Exchanges once; with distributed clocks also returns the time from now until the next exchange.
    async fn send<'s>(
        &self,
        main: &'s MainDevice<'s>,
    ) -> Result<(TxRxResponse<TERMINALS_MAX, Self::Extra>, Option<Duration>), Error>;
}

impl<S: HasPdi> ExchangingGroup for Group<S, NoDc> {
    type Extra = ();

    async fn send<'s>(
        &self,
        main: &'s MainDevice<'s>,
    ) -> Result<(TxRxResponse<TERMINALS_MAX>, Option<Duration>), Error> {
        Ok((self.tx_rx(main).await?, None))
    }
}

impl<S: HasPdi> ExchangingGroup for Group<S, HasDc> {
    type Extra = CycleInfo;

    async fn send<'s>(
        &self,
        main: &'s MainDevice<'s>,
    ) -> Result<(TxRxResponse<TERMINALS_MAX, CycleInfo>, Option<Duration>), Error> {
        let answer = self.tx_rx_dc(main).await?;
        let wait = answer.extra.next_cycle_wait;
        Ok((answer, Some(wait)))
    }
}

/// Starts the line and exchanges.
pub(super) async fn run(
    main: &MainDevice<'_>,
    options: &SessionOptions,
    application: &mut impl Application,
) -> Result<(), SessionError> {
    let ended = async {
        while !application.must_end() {
            Timer::after(END_STEP).await;
        }
        None
    };
    let started = async { Some(start::start(main, options).await) };
    let Some(line) = future::or(started, ended).await else {
        return Ok(());
    };
    match line? {
        StartedLine::Free(group) => hold(main, options, application, group).await,
        StartedLine::Clocked(group) => hold(main, options, application, group).await,
    }
}

/// Exchanges with a line in SAFEOP.
async fn hold<Clocks>(
    main: &MainDevice<'_>,
    options: &SessionOptions,
    application: &mut impl Application,
    group: Group<SafeOp, Clocks>,
) -> Result<(), SessionError>
where
    Group<SafeOp, Clocks>: ExchangingGroup,
    Group<Op, Clocks>: ExchangingGroup,
{
    let mut image: Vec<TerminalImage> = group
        .iter(main)
        .map(|terminal| TerminalImage {
            inputs: vec![0; terminal.inputs_raw().len()],
            outputs: vec![0; terminal.outputs_raw().len()],
        })
        .collect();
    if application.cycle(&mut image, Cycle::First).is_break() {
        return Ok(());
    }
    let mut session = Session {
        main,
        options,
        application,
        image,
        next: Instant::now(),
        clocked: None,
        complete_at: Instant::now(),
        unanswered: false,
    };
    let Some(group) = session.observe(group).await? else {
        return Ok(());
    };
    session.drive(&group).await?;
    // The terminals switch off now, and not by their watchdogs. One that does not follow has its watchdog.
    let off = async { group.into_safe_op(main).await.is_ok() };
    let late = async {
        Timer::after(SWITCH_OFF).await;
        false
    };
    if !future::or(off, late).await {
        tracing::debug!("the line did not go to SAFEOP in time");
    }
    Ok(())
}

/// A line that exchanges.
struct Session<'a, A> {
    main: &'a MainDevice<'a>,
    options: &'a SessionOptions,
    application: &'a mut A,
    image: Vec<TerminalImage>,
    /// Start of the next period.
    next: Instant,
    /// The same by the reference clock, after an exchange that has told its time.
    clocked: Option<Instant>,
    /// Time of the last complete exchange, or of the last question whether all terminals are there.
    complete_at: Instant,
    /// A terminal gave no state in the last answer.
    unanswered: bool,
}

impl<A: Application> Session<'_, A> {
    /// Exchanges inputs until the application drives outputs, then requests OP. Returns `None` if the application ends.
    async fn observe<Clocks>(
        &mut self,
        group: Group<SafeOp, Clocks>,
    ) -> Result<Option<Group<Op, Clocks>>, SessionError>
    where
        Group<SafeOp, Clocks>: ExchangingGroup,
    {
        while !self.application.drives_outputs() {
            let cycle = self.exchange(&group, SubDeviceState::SafeOp, true).await?;
            let cycle = match cycle {
                Cycle::Complete => Cycle::InputsOnly,
                other => other,
            };
            if self.application.cycle(&mut self.image, cycle).is_break() {
                return Ok(None);
            }
            self.find_restarted().await?;
            self.wait().await;
        }
        // Not waited for here: the outputs must flow meanwhile, or their watchdogs expire.
        let group = group.request_into_op(self.main).await;
        group.map(Some).map_err(|error| start::fault("OP", error))
    }

    /// Exchanges until the application ends.
    async fn drive<Clocks>(&mut self, group: &Group<Op, Clocks>) -> Result<(), SessionError>
    where
        Group<Op, Clocks>: ExchangingGroup,
    {
        let started = Instant::now();
        let mut running = false;
        let mut errors = (0..self.image.len()).cycle();
        let mut errors_at = started;
        loop {
            let cycle = self.exchange(group, SubDeviceState::Op, running).await?;
            running |= cycle == Cycle::Complete;
            if !running && started.elapsed() > STATE_CHANGE {
                return Err(SessionError::Start {
                    state: "OP",
                    cause: "the terminals did not follow in 10 s".to_owned(),
                });
            }
            if self.application.cycle(&mut self.image, cycle).is_break() {
                return Ok(());
            }
            self.find_restarted().await?;
            if cycle == Cycle::Complete && errors_at <= Instant::now() {
                errors_at = Instant::now() + ERRORS_EVERY;
                if let Some(position) = errors.next() {
                    self.read_errors(group, position).await;
                    self.read_clock(group, position).await;
                }
            }
            self.wait().await;
        }
    }

    /// A terminal that was without power is in INIT and has no address, so it never takes part again: if one does not answer by
    /// its address although all are there, the session ends. Until they are, the others get their outputs.
    async fn find_restarted(&mut self) -> Result<(), SessionError> {
        if !self.unanswered || self.complete_at.elapsed() < POWER_LOST {
            return Ok(());
        }
        self.complete_at = Instant::now();
        let count = u16::try_from(self.image.len()).unwrap_or(u16::MAX);
        let asked = async {
            let all = Command::brd(RegisterAddress::Type.into()).with_wkc(count);
            all.receive::<u8>(self.main).await.ok()
        };
        match future::or(asked, after(self.options.timeout)).await {
            Some(_) => Err(SessionError::Restarted),
            None => Ok(()),
        }
    }

    /// Waits for the next period; late ones are left out. Without an answer the reference clock is unknown: the period is this
    /// machine's then.
    async fn wait(&mut self) {
        let own = || following(self.next, Instant::now(), self.options.period);
        self.next = self.clocked.take().unwrap_or_else(own);
        Timer::at(self.next).await;
    }

    /// Exchanges once and judges the answer; the inputs of an incomplete exchange are not taken. A terminal that has left
    /// `state` ends the session if all have been in it before (`running`).
    async fn exchange<S: HasPdi, Clocks>(
        &mut self,
        group: &Group<S, Clocks>,
        state: SubDeviceState,
        running: bool,
    ) -> Result<Cycle, SessionError>
    where
        Group<S, Clocks>: ExchangingGroup,
    {
        for (terminal, image) in group.iter(self.main).zip(&self.image) {
            terminal.outputs_raw_mut().copy_from_slice(&image.outputs);
        }
        let sent = Instant::now();
        let answer = async { group.send(self.main).await.ok() };
        let Some((answer, wait)) = future::or(answer, after(self.options.timeout)).await else {
            self.unanswered = true;
            return Ok(Cycle::Lost(Loss::Silent));
        };
        self.clocked = wait.map(|wait| sent + wait);
        self.application.states(&answer.subdevice_states);
        self.unanswered = answer.subdevice_states.contains(&SubDeviceState::None);
        let (have, want) = (answer.working_counter, expected_counter(&self.image));
        if have != want {
            return Ok(Cycle::Lost(Loss::WorkingCounter { have, want }));
        }
        let mut states = answer.subdevice_states.iter().zip(0..);
        if let Some((shown, position)) = states.find(|(own, _)| **own != state) {
            return match running {
                false => Ok(Cycle::Lost(Loss::Starting)),
                true => match self.left(group, position, [state, *shown]).await {
                    None => Ok(Cycle::Lost(Loss::Unconfirmed)),
                    Some(error) => Err(error),
                },
            };
        }
        for (terminal, image) in group.iter(self.main).zip(&mut self.image) {
            image.inputs.copy_from_slice(&terminal.inputs_raw());
        }
        self.complete_at = Instant::now();
        Ok(Cycle::Complete)
    }

    /// Asks a terminal that seems to have left `state` (its answer: `shown`); returns the error if it confirms that, with the
    /// reason that it gives.
    async fn left<S: HasPdi, Clocks>(
        &self,
        group: &Group<S, Clocks>,
        position: usize,
        [state, shown]: [SubDeviceState; 2],
    ) -> Option<SessionError> {
        let asked = async {
            let terminal = group.subdevice(self.main, position).ok()?;
            match terminal.status().await {
                Ok((own, code)) => Some((own, code)),
                // Its error flag is set.
                Err(Error::SubDevice(code)) => Some((shown, code)),
                Err(_) => None,
            }
        };
        let (own, code) = future::or(asked, after(self.options.timeout)).await?;
        let expected = self.options.line.get(position);
        let cause = match code {
            AlStatusCode::NoError => String::new(),
            code => format!(", because of its AL status code {code}"),
        };
        (own != state).then(|| SessionError::Left {
            position: position + 1,
            name: expected.map_or_else(String::new, |one| one.name.clone()),
            state: own.to_string(),
            cause,
        })
    }

    /// Reads how far the clock of a terminal is from the reference clock; of one without a clock nothing.
    async fn read_clock<Clocks>(&mut self, group: &Group<Op, Clocks>, position: usize) {
        if self.options.clocks.is_none() {
            return;
        }
        let read = async {
            let terminal = group.subdevice(self.main, position).ok()?;
            let register = RegisterAddress::DcSystemTimeDifference;
            match terminal.dc_support().any() {
                true => terminal.register_read::<u32>(register).await.ok(),
                false => None,
            }
        };
        if let Some(raw) = future::or(read, after(self.options.timeout)).await {
            self.application
                .clock_difference(position, clock_difference(raw));
        }
    }

    async fn read_errors<Clocks>(&mut self, group: &Group<Op, Clocks>, position: usize) {
        let read = async {
            let terminal = group.subdevice(self.main, position).ok()?;
            let bytes = terminal.register_read::<[u8; PortErrors::SIZE]>(PortErrors::FIRST);
            bytes.await.ok()
        };
        if let Some(bytes) = future::or(read, after(self.options.timeout)).await {
            self.application
                .port_errors(position, PortErrors::read(bytes));
        }
    }
}

/// Returns a difference of clocks, ns, of the register 0x092C: an amount, and in bit 31 whether the own time is the smaller one.
fn clock_difference(raw: u32) -> i64 {
    let amount = i64::from(raw & 0x7fff_ffff);
    if raw >> 31 == 1 { -amount } else { amount }
}

/// Is nothing, after this time.
async fn after<T>(time: Duration) -> Option<T> {
    Timer::after(time).await;
    None
}

/// Returns the first start of a period after `now`: late periods are left out.
fn following(last: Instant, now: Instant, period: Duration) -> Instant {
    let behind = now.saturating_duration_since(last).as_nanos() / period.as_nanos().max(1);
    last + period.saturating_mul(u32::try_from(behind).unwrap_or(u32::MAX - 1) + 1)
}

/// Returns the working counter of a complete exchange by LRW: 1 for inputs and 2 for outputs of each terminal.
fn expected_counter(image: &[TerminalImage]) -> u16 {
    let of = |one: &TerminalImage| {
        u16::from(!one.inputs.is_empty()) + 2 * u16::from(!one.outputs.is_empty())
    };
    image.iter().map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_periods_are_left_out() {
        let start = Instant::now();
        let ms = Duration::from_millis;
        let next = |late| following(start, start + late, ms(2)) - start;
        assert_eq!(next(ms(0)), ms(2));
        assert_eq!(next(ms(1)), ms(2));
        assert_eq!(next(ms(7)), ms(8));
    }

    #[test]
    fn a_difference_of_clocks_has_its_sign_in_bit_31() {
        assert_eq!(clock_difference(0), 0);
        assert_eq!(clock_difference(250), 250);
        assert_eq!(clock_difference(0x8000_0003), -3);
    }

    #[test]
    fn each_port_has_its_counters() {
        let bytes = std::array::from_fn(|at| at as u8);
        let errors = PortErrors::read(bytes);
        assert_eq!(errors.invalid_frames, [0, 2, 4, 6]);
        assert_eq!(errors.receive_errors, [1, 3, 5, 7]);
        assert_eq!(errors.forwarded, [8, 9, 10, 11]);
        assert_eq!(errors.lost_links, [16, 17, 18, 19]);
    }
}
