use std::sync::Mutex;

use mapping::Mapper;
use measurement::Twist;
use measurement::pose::planar;
use protocol::tile::{BootId, TileKey};
use protocol::tile_store::LayerGrid;
use recording::ros::middleware::{Attachment, rmw_keys};
use zenoh::Session;
use zenoh::Wait as _;
use zenoh::query::ReplyKeyExpr;

use super::super::test_router::{self, announced, free_endpoint};
use super::*;
use crate::config;
use crate::publishing::cells_to_tiles::uniform_tile;
use crate::publishing::trajectory::SharedTrajectory;

const DOMAIN: u32 = 7;
const FREE: u16 = 6;
const OCCUPIED: u16 = 246;

const CONFIG: &str = r#"
map = { topic = "/bot/map", rate_hz = 20.0, max_kb = 100 }
cost_map = { topic = "/cost_map", rate_hz = 20.0, max_kb = 4 }
elevation = { topic = "/elevation", rate_hz = 20.0, max_kb = 100 }
voxels = { topic = "/octomap", rate_hz = 20.0, max_kb = 100 }
obstacles = { topic = "/obstacles", rate_hz = 20.0, max_kb = 1000 }
tf = { topic = "/tf", rate_hz = 50.0, max_kb = 1 }
odometry = { topic = "/odometry", rate_hz = 50.0, max_kb = 1 }
path = { topic = "/path", rate_hz = 20.0, max_kb = 100 }
"#;

/// A router with an output behind it.
struct Rig {
    router: Session,
    store: Arc<Mutex<TileStore>>,
    inputs: OutputInputs,
    output: RosOutput,
}

impl Rig {
    fn start() -> Self {
        let endpoint = free_endpoint();
        let mut store = TileStore::new(BootId([1; 16]), 10);
        for layer in [
            LayerId::Occupancy,
            LayerId::Cost,
            LayerId::Elevation,
            LayerId::Obstacle,
        ] {
            store.set_grid(LayerGrid { layer, cell_m: 0.5 }).unwrap();
        }
        let (store, inputs) = (Arc::new(Mutex::new(store)), OutputInputs::default());
        // The output waits for its router.
        let at = RosEndpoint {
            endpoint: endpoint.clone(),
            domain: DOMAIN,
        };
        let sources = OutputSources {
            inputs: inputs.clone(),
            store: Arc::clone(&store),
            trajectory: SharedTrajectory::default(),
        };
        let output = RosOutput::start(
            &toml::from_str(CONFIG).unwrap(),
            ("odom", "base_link"),
            RosTarget::Endpoint(at),
            sources,
        )
        .unwrap();
        Self {
            router: test_router::start(&endpoint),
            store,
            inputs,
            output,
        }
    }

    fn publish(&self, layer: LayerId, [tx, ty]: [i32; 2], code: u16) {
        let key = TileKey { layer, tx, ty };
        let published = self.store.lock().unwrap().publish(key, uniform_tile(code));
        assert!(published.is_ok());
    }

    fn key(topic: &str, kind: PublishedType) -> String {
        rmw_keys(DOMAIN, topic, kind).unwrap()[0].clone()
    }

    /// The messages of a topic, as a node of ROS receives them.
    fn subscribe(&self, topic: &str, kind: PublishedType) -> Arc<Mutex<Vec<Vec<u8>>>> {
        let received = Arc::new(Mutex::new(Vec::new()));
        let of_callback = Arc::clone(&received);
        self.router
            .declare_subscriber(Self::key(topic, kind))
            .callback(move |sample| {
                // `rmw_zenoh` drops messages without one.
                let attachment = sample.attachment().unwrap().to_bytes();
                assert!(Attachment::decode(&attachment).is_some());
                let message = sample.payload().to_bytes().into_owned();
                of_callback.lock().unwrap().push(message);
            })
            .background()
            .wait()
            .unwrap();
        received
    }

    /// The last message, as a late subscriber asks for it.
    fn history(&self, topic: &str, kind: PublishedType) -> Option<Vec<u8>> {
        let replies = self
            .router
            .get(format!("{}/@adv/**", Self::key(topic, kind)))
            .accept_replies(ReplyKeyExpr::Any)
            .timeout(Duration::from_secs(10))
            .wait()
            .unwrap();
        let reply = replies.recv().ok()?;
        let sample = reply.result().ok()?;
        assert_eq!(sample.key_expr().as_str(), Self::key(topic, kind));
        Some(sample.payload().to_bytes().into_owned())
    }
}

fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let began = clock::now();
    while !is_so() {
        assert!(clock::elapsed(began) < Duration::from_mins(1), "{what}");
        thread::sleep(Duration::from_millis(5));
    }
}

/// The cells at the end of a grid or update of `count` cells.
fn cells(message: &[u8], count: usize) -> Vec<i8> {
    let (_, cells) = message.split_at(message.len() - count);
    cells.iter().map(|cell| cell.cast_signed()).collect()
}

#[test]
fn topics_are_listed_and_early_and_late_subscribers_have_the_map() {
    let rig = Rig::start();
    let mut expected: Vec<_> = [
        ("/bot/map", PublishedType::OCCUPANCY_GRID),
        ("/bot/map_updates", PublishedType::OCCUPANCY_GRID_UPDATE),
        ("/cost_map", PublishedType::OCCUPANCY_GRID),
        ("/cost_map_updates", PublishedType::OCCUPANCY_GRID_UPDATE),
        ("/elevation", PublishedType::GRID_MAP),
        ("/octomap", PublishedType::OCTOMAP),
        ("/obstacles", PublishedType::POINT_CLOUD),
        ("/tf", PublishedType::TF),
        ("/odometry", PublishedType::ODOMETRY),
        ("/path", PublishedType::PATH),
    ]
    .into_iter()
    .map(|(topic, kind)| (topic.to_owned(), kind.name.to_owned()))
    .collect();
    expected.sort();
    wait_until("tokens", || announced(&rig.router) == expected);

    let map = rig.subscribe("/bot/map", PublishedType::OCCUPANCY_GRID);
    let updates = rig.subscribe("/bot/map_updates", PublishedType::OCCUPANCY_GRID_UPDATE);
    rig.publish(LayerId::Occupancy, [0, 0], FREE);
    rig.publish(LayerId::Occupancy, [1, 0], FREE);
    wait_until("the whole grid", || {
        let map = map.lock().unwrap();
        map.last()
            .is_some_and(|message| cells(message, 2 * 4096) == [0; 2 * 4096])
    });
    rig.publish(LayerId::Occupancy, [1, 0], OCCUPIED);
    wait_until("an update", || !updates.lock().unwrap().is_empty());
    assert_eq!(cells(&updates.lock().unwrap()[0], 4096), [100; 4096]);

    let late = rig
        .history("/bot/map", PublishedType::OCCUPANCY_GRID)
        .unwrap();
    let row = [[0; 64], [100; 64]].concat();
    assert_eq!(cells(&late, 2 * 4096), row.repeat(64));
}

#[test]
fn nothing_is_made_for_nobody_and_what_is_too_large_is_counted() {
    let rig = Rig::start();
    let config = config::load("generic3d", &[]).unwrap();
    let mapper = Mapper::new(
        &config.mapping,
        config.vehicle.shape(),
        &config.range_models(),
    );
    let octree = mapper.voxels().unwrap().octree();
    let offer = |stamp| {
        rig.inputs
            .offer_octree(RobotTime::from_nanos(stamp), octree);
    };
    rig.publish(LayerId::Cost, [0, 0], 1);
    thread::sleep(Duration::from_millis(1500));
    offer(1);
    assert!(!rig.inputs.has_octree_request(), "nobody subscribes");

    let poses = rig.subscribe("/tf", PublishedType::TF);
    let octomaps = rig.subscribe("/octomap", PublishedType::OCTOMAP);
    let costs = rig.subscribe("/cost_map", PublishedType::OCCUPANCY_GRID);
    let vehicle = VehicleState {
        stamp: RobotTime::from_nanos(5),
        odom_from_base: planar(1.0, 2.0, 0.0),
        map_from_odom: Some(planar(10.0, 0.0, 0.0)),
        twist: Twist {
            linear_mps: [0.0; 3],
            angular_radps: [0.0; 3],
        },
    };
    rig.inputs.set_vehicle(vehicle);
    wait_until("a pose and an octree", || {
        offer(2);
        !poses.lock().unwrap().is_empty() && !octomaps.lock().unwrap().is_empty()
    });
    let expected = transforms(
        vehicle.stamp,
        &[
            ("map", "odom", vehicle.map_from_odom.unwrap()),
            ("odom", "base_link", vehicle.odom_from_base),
        ],
    );
    assert_eq!(*poses.lock().unwrap(), [expected]);
    // 4096 cells and a header.
    let mut warnings = Vec::new();
    wait_until("a warning", || {
        warnings.extend(rig.inputs.take_warnings());
        !warnings.is_empty()
    });
    assert!(
        warnings.len() == 1 && warnings[0].contains("/cost_map") && warnings[0].contains("4 kB"),
        "{warnings:?}"
    );
    assert_eq!(*costs.lock().unwrap(), [[0_u8; 0]; 0]);
    let drops = rig.output.finish();
    let too_large = drops.get(&("/cost_map".to_owned(), "messages larger than max_kb"));
    assert!(too_large.is_some_and(|&count| count > 0), "{drops:?}");
    assert_eq!(drops.len(), 1, "{drops:?}");
}
