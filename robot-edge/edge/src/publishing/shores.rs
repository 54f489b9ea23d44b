//! Shores and docking sites of the mapping core become those of the wire here, and nowhere else.

use protocol::message::{self, Shores};
use protocol::shores::convex_outline;

use mapping::docking::DockingSite;
use mapping::shore::ShoreLayer;
use mapping::shore::{ShoreClass, ShoreCluster};
use protocol::geodesy::GeodeticPoint;

/// All that is known of shores, in cells of `cell_m`; `datum` is where on Earth `odom` is.
pub fn shores(layer: &ShoreLayer, cell_m: f64, datum: Option<GeodeticPoint>) -> Shores {
    let clusters = layer.clusters().map(cluster).collect();
    let sites = layer.docking_sites().iter().map(site).collect();
    Shores::gather(cell_m, datum, clusters, sites)
}

fn cluster(cluster: &ShoreCluster) -> message::ShoreCluster {
    message::ShoreCluster {
        number: cluster.number,
        class: match cluster.class {
            ShoreClass::Sparse => message::ShoreClass::Sparse,
            ShoreClass::Dense => message::ShoreClass::Dense,
            ShoreClass::Solid => message::ShoreClass::Solid,
        },
        voxels: cluster.voxels,
        rigid_voxels: cluster.rigid_voxels,
        center_m: cluster
            .centre_in_odom
            .xy()
            .map(|metres| metres as f32)
            .into(),
        outline: convex_outline(cluster.columns.iter().map(|cell| (cell.x, cell.y))),
    }
}

fn site(site: &DockingSite) -> message::DockingSite {
    message::DockingSite {
        center_m: site.centre_in_odom.map(|metres| metres as f32).into(),
        heading_rad: site.heading_rad as f32,
        width_m: site.width_m as f32,
        mean_cost: site.mean_cost as f32,
    }
}
