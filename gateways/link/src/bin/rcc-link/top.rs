//! `rcc-link top`: the screen of a fleet. Run by the main thread.

use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

use ratatui::Frame;
use rcc_link::fleet;
use rcc_link::screen::{FleetNews, FleetState};
use rcc_process::Stop;
use rcc_terminal::live::{self, LiveView};

use crate::reach::Reach;
use crate::{LinkError, stop_at};

/// Interval at which the screen of a fleet is drawn.
const EVERY: Duration = Duration::from_millis(500);
/// Time for the first overviews to arrive: each cell sends one a second.
const FIRST: Duration = Duration::from_millis(1500);
/// Time limit for the overviews of all alive cells, with `--once`.
const ALL: Duration = Duration::from_secs(5);
/// News of cells that wait to be drawn.
const NEWS_MAX: usize = 4096;

/// The live view of a fleet.
struct TopView {
    fleet: FleetState,
    news: Receiver<FleetNews>,
}

impl TopView {
    /// Waits for the first overviews; with `all`, longer, until each alive cell has sent one.
    fn await_overviews(&mut self, all: bool) {
        let begun = Instant::now();
        loop {
            let limit = match all && self.fleet.is_awaited() {
                true => ALL,
                false => FIRST,
            };
            let Ok(news) = self
                .news
                .recv_timeout(limit.saturating_sub(begun.elapsed()))
            else {
                return;
            };
            self.fleet.apply(news, Instant::now());
        }
    }
}

impl LiveView for TopView {
    fn draw(&self, frame: &mut Frame<'_>) {
        self.fleet.draw(frame, Instant::now());
    }

    fn refresh(&mut self) {
        let now = Instant::now();
        // No more than can wait, so that the screen is drawn however fast they come.
        for news in self.news.try_iter().take(NEWS_MAX) {
            self.fleet.apply(news, now);
        }
    }

    fn key(&mut self, _: char) -> bool {
        false
    }
}

/// Shows the cells of a site, live or once as text.
pub fn top(reach: &Reach, site: &str, once: bool) -> Result<(), LinkError> {
    // Before the first thread, which inherits the mask.
    let signals = Stop::prepare(false)?;
    let session = reach.session()?;
    let (told, news) = sync_channel(NEWS_MAX);
    fleet::watch(&session, site, &told)?;
    let mut view = TopView {
        fleet: FleetState::default(),
        news,
    };
    let once = once || !live::is_possible();
    view.await_overviews(once);
    if once {
        for line in view.fleet.lines(usize::MAX, Instant::now()) {
            rcc_process::say(&line);
        }
        return Ok(());
    }
    let stop = stop_at(signals)?;
    // Acquire pairs with the release of the thread that waits for signals.
    live::show(&mut view, EVERY, || stop.load(Ordering::Acquire))?;
    Ok(())
}
