//! `--demo`: a simulated robot in this process, reached over the network like any other.

use std::io;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{self, JoinHandle};

use anyhow::{Context as _, anyhow};
use clap::Parser as _;
use etcetera::{BaseStrategy as _, choose_base_strategy};
use protocol::keys::RobotId;
use robot_edge::cli::Cli;
use robot_edge::simulation::World;

/// What the simulated robot is called.
const NAME: &str = "demo";
/// A simulated robot. Dropping it ends the simulation.
pub struct Demo {
    /// Its name.
    pub robot: RobotId,
    /// Where it is.
    pub endpoint: String,
    is_over: Arc<AtomicBool>,
    failed: Receiver<anyhow::Error>,
    thread: Option<JoinHandle<()>>,
}

impl Demo {
    /// Starts a robot in `world` (a name or a file), on a port of this machine that is free.
    ///
    /// # Errors
    /// Where there is no such world, or no port is free.
    pub fn start(world: &str) -> anyhow::Result<Self> {
        // Before a window opens that would wait for it.
        World::load(world)?;
        let endpoint = free_endpoint().context("no port is free for the simulated robot")?;
        let mut words = vec![
            "robot-edge",
            "simulate",
            world,
            "--robot",
            NAME,
            "--listen",
            &endpoint,
            "--stay",
            "--quiet",
        ];
        let recordings = recordings_folder();
        if let Some(folder) = &recordings {
            words.extend(["--recordings", folder]);
        }
        let cli = Cli::try_parse_from(words)?;
        let is_over = Arc::new(AtomicBool::new(false));
        let (sender, failed) = sync_channel(1);
        let thread = thread::spawn({
            let is_over = Arc::clone(&is_over);
            move || {
                let ended = robot_edge::app::run_until(&cli, &is_over, &mut io::sink());
                if let Err(why) = ended
                    && !is_over.load(Ordering::Relaxed)
                {
                    // The channel has room for the one failure there can be.
                    drop(sender.try_send(why));
                }
            }
        });
        Ok(Self {
            robot: NAME.parse()?,
            endpoint,
            is_over,
            failed,
            thread: Some(thread),
        })
    }

    /// Why there is no simulation any more.
    pub fn failure(&self) -> Option<anyhow::Error> {
        self.failed.try_recv().ok()
    }
}

impl Drop for Demo {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the simulation failed");
        }
    }
}

/// Where a demonstration's recordings go: `foreshore/recordings` in the user's data (XDG). `None` where it cannot be
/// made, which is no reason not to demonstrate.
fn recordings_folder() -> Option<String> {
    let data = choose_base_strategy().ok()?.data_dir();
    let folder = data.join("foreshore").join("recordings");
    std::fs::create_dir_all(&folder)
        .inspect_err(|error| tracing::warn!(%error, "the demonstration records nothing"))
        .ok()?;
    folder.into_os_string().into_string().ok()
}

/// Two ports of this machine, one after the other, that nobody listens on.
pub(crate) fn free_endpoint() -> anyhow::Result<String> {
    for _attempt in 0..100 {
        let control = TcpListener::bind(("127.0.0.1", 0))?;
        let port = control.local_addr()?.port();
        if port < u16::MAX && TcpListener::bind(("127.0.0.1", port + 1)).is_ok() {
            return Ok(format!("tcp/127.0.0.1:{port}"));
        }
    }
    Err(anyhow!("no two neighbouring ports are free"))
}
