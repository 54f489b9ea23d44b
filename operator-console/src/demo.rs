//! `--demo`: a simulated robot in this process, reached over the network as any other.

use std::io;
use std::net::TcpListener;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use anyhow::{Context as _, anyhow};
use clap::Parser as _;
use edge::cli::Cli;
use etcetera::{BaseStrategy as _, choose_base_strategy};
use protocol::keys::RobotId;
use simulation::World;

use crate::lock;
use crate::playback::in_words;

const NAME: &str = "demo";

/// Dropping it ends the simulation.
pub struct Demo {
    pub robot: RobotId,
    pub endpoint: String,
    pub recordings: Option<PathBuf>,
    pub failure: DemoFailure,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Clone, Debug, Default)]
pub struct DemoFailure(Arc<Mutex<Option<anyhow::Error>>>);

impl DemoFailure {
    pub fn message(&self) -> Option<String> {
        lock(&self.0).as_ref().map(in_words)
    }

    pub fn take(&self) -> Option<anyhow::Error> {
        lock(&self.0).take()
    }

    fn set(&self, why: anyhow::Error) {
        *lock(&self.0) = Some(why);
    }
}

impl Demo {
    /// Starts a robot in `world` (a name or a file) on a free port of this machine.
    pub fn start(world: &str) -> anyhow::Result<Self> {
        // Fail before the window opens.
        World::load(world)?;
        let endpoint = free_endpoint().context("no port is free for the simulated robot")?;
        let mut args = vec![
            "robot-edge",
            "simulate",
            world,
            "--robot",
            NAME,
            "--listen",
            &endpoint,
            "--keep-serving",
            "--quiet",
        ];
        let recordings = recordings_folder();
        if let Some(folder) = &recordings {
            args.extend(["--recordings", folder]);
        }
        let cli = Cli::try_parse_from(args)?;
        let is_over = Arc::new(AtomicBool::new(false));
        let failure = DemoFailure::default();
        let thread = thread::spawn({
            let (is_over, failure) = (Arc::clone(&is_over), failure.clone());
            move || {
                let ended = edge::runtime::run_until(&cli, &is_over, &mut io::sink());
                if let Err(why) = ended
                    && !is_over.load(Ordering::Relaxed)
                {
                    failure.set(why);
                }
            }
        });
        Ok(Self {
            robot: NAME.parse()?,
            endpoint,
            recordings: recordings.map(PathBuf::from),
            failure,
            is_over,
            thread: Some(thread),
        })
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

/// `foreshore/recordings` in the user's data folder (XDG); `None` if it cannot be created.
fn recordings_folder() -> Option<String> {
    let data = choose_base_strategy().ok()?.data_dir();
    let folder = data.join("foreshore").join("recordings");
    std::fs::create_dir_all(&folder)
        .inspect_err(|error| tracing::warn!(%error, "the demo does not record"))
        .ok()?;
    folder.into_os_string().into_string().ok()
}

/// The first of two consecutive free ports of this machine.
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
