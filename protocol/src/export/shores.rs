//! Shores and docking sites as `GeoJSON`.

use std::cmp::Reverse;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::geojson::{Feature, Geometry, Projection, rounded, write_features};
use super::{ExportError, Label};
use crate::export::write_atomically;
use crate::message::{DockingSite, ShoreCluster, Shores};
use crate::shores::site_letters;

#[derive(Serialize)]
struct ClusterProperties {
    kind: &'static str,
    number: u32,
    class: &'static str,
    /// Share of rigid voxels, to 10⁻⁴.
    ratio: f64,
    voxels: u32,
    rigid_voxels: u32,
    /// Mean of its voxels.
    center: [f64; 2],
}

#[derive(Serialize)]
struct SiteProperties {
    kind: &'static str,
    name: String,
    rank: usize,
    /// Direction of the bow on the way in: counter-clockwise from x of `odom`; `bearing_deg` is
    /// clockwise from north.
    heading_deg: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    bearing_deg: Option<f64>,
    width_m: f64,
    /// Gentle slope, sparse or dense.
    class: &'static str,
    price: f64,
    /// Where the way in begins.
    approach: [f64; 2],
}

impl Projection {
    fn cluster(&self, cluster: &ShoreCluster, cell_m: f64) -> Feature<ClusterProperties> {
        let center = self.coordinates(cluster.center_m.map(f64::from));
        let corner = |&(x, y): &(i32, i32)| self.coordinates([x, y].map(|n| f64::from(n) * cell_m));
        let geometry = match &cluster.outline[..] {
            [first, _, _, ..] => {
                let ring = cluster.outline.iter().chain([first]);
                Geometry::Polygon([ring.map(corner).collect()])
            }
            [] | [_] | [_, _] => Geometry::Point(center),
        };
        let properties = ClusterProperties {
            kind: "shore",
            number: cluster.number,
            class: cluster.class.name(),
            ratio: rounded(cluster.ratio(), 1e4),
            voxels: cluster.voxels,
            rigid_voxels: cluster.rigid_voxels,
            center,
        };
        Feature::new(geometry, properties)
    }

    fn site(&self, site: &DockingSite, rank: usize) -> Feature<SiteProperties> {
        let heading_deg = f64::from(site.heading_rad).to_degrees();
        let turned = |deg: f64| {
            let deg = rounded(deg.rem_euclid(360.0), 1e1);
            // 360 after rounding is 0.
            if deg < 360.0 { deg } else { 0.0 }
        };
        let properties = SiteProperties {
            kind: "docking site",
            name: site_letters(site.number),
            rank,
            heading_deg: turned(heading_deg),
            bearing_deg: self.is_on_earth().then(|| turned(90.0 - heading_deg)),
            width_m: rounded(f64::from(site.width_m), 1e3),
            class: site.ground_name(),
            price: rounded(f64::from(site.price), 1e4),
            approach: self.coordinates(site.approach_m.map(f64::from)),
        };
        let place = self.coordinates(site.center_m.map(f64::from));
        Feature::new(Geometry::Point(place), properties)
    }
}

/// Letters of the docking sites, the best first, then numbers of the shores, the largest first.
pub fn shore_labels(shores: &Shores) -> Vec<Label> {
    let sites = shores.sites.iter().map(|site| Label {
        text: site_letters(site.number),
        at_m: site.center_m.map(f64::from),
    });
    let mut clusters: Vec<_> = shores.clusters.iter().collect();
    clusters.sort_by_key(|cluster| (Reverse(cluster.voxels), cluster.number));
    let clusters = clusters.into_iter().map(|cluster| Label {
        text: cluster.number.to_string(),
        at_m: cluster.center_m.map(f64::from),
    });
    sites.chain(clusters).collect()
}

/// Writes `shores.geojson` to `dir`, which is created if necessary; returns its path.
///
/// Equal shores give equal bytes.
pub fn write_shores(dir: &Path, shores: &Shores) -> Result<PathBuf, ExportError> {
    let path = dir.join("shores.geojson");
    std::fs::create_dir_all(dir).map_err(ExportError::at(&path))?;
    write_atomically(&path, |writer| Ok(write_collection(writer, shores)?))?;
    Ok(path)
}

fn write_collection(writer: &mut impl Write, shores: &Shores) -> io::Result<()> {
    let projection = Projection::new(shores.datum);
    let members = format!(
        "\"outlines\":\"convex, of 12 corners at most\",\n\
         \"shores_left_out\":{},\n\
         \"docking_sites_left_out\":{},\n",
        shores.clusters_left_out, shores.sites_left_out
    );
    projection.begin(writer, &members)?;
    let mut separator = "\n";
    let clusters = shores.clusters.iter();
    let clusters = clusters.map(|cluster| projection.cluster(cluster, shores.cell_m));
    write_features(writer, clusters, &mut separator)?;
    let sites = shores.sites.iter().zip(1..);
    let sites = sites.map(|(site, rank)| projection.site(site, rank));
    write_features(writer, sites, &mut separator)?;
    writer.write_all(b"\n]}\n")
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::message::{Datum, ShoreClass};

    fn shores(datum: Option<Datum>) -> Shores {
        let dense = ShoreCluster {
            number: 7,
            class: ShoreClass::Dense,
            voxels: 3,
            rigid_voxels: 1,
            center_m: [0.5, -0.25],
            outline: vec![(-1, -2), (3, -2), (3, 1)],
        };
        let point = ShoreCluster {
            number: 8,
            class: ShoreClass::Solid,
            outline: Vec::new(),
            ..dense.clone()
        };
        let site = DockingSite {
            center_m: [10.0, 20.0],
            heading_rad: std::f32::consts::FRAC_PI_2,
            width_m: 6.3,
            vegetation: Some(ShoreClass::Dense),
            price: 1.12345,
            approach_m: [10.0, 15.5],
            number: 2,
        };
        let mut shores = Shores::gather(0.25, datum, vec![point, dense], vec![site]);
        shores.clusters_left_out = 4;
        shores
    }

    fn text(shores: &Shores) -> String {
        let dir = tempfile::tempdir().unwrap();
        let path = write_shores(&dir.path().join("made"), shores).unwrap();
        assert!(path.ends_with("made/shores.geojson"));
        std::fs::read_to_string(path).unwrap()
    }

    #[test]
    fn without_datum_coordinates_are_metres() {
        let text = text(&shores(None));
        assert_eq!(
            text,
            "{\"type\":\"FeatureCollection\",\n\
             \"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"LOCAL_CS[\\\"odom\\\",UNIT[\\\"metre\\\",1]]\"}},\n\
             \"coordinate_reference\":\"NOT WGS-84: x and y in metres in odom, because there was no satellite fix\",\n\
             \"outlines\":\"convex, of 12 corners at most\",\n\
             \"shores_left_out\":4,\n\
             \"docking_sites_left_out\":0,\n\
             \"features\":[\n\
             {\"type\":\"Feature\",\"geometry\":{\"type\":\"Polygon\",\"coordinates\":\
             [[[-0.25,-0.5],[0.75,-0.5],[0.75,0.25],[-0.25,-0.5]]]},\"properties\":{\"kind\":\"shore\",\
             \"number\":7,\"class\":\"dense\",\"ratio\":0.3333,\"voxels\":3,\"rigid_voxels\":1,\
             \"center\":[0.5,-0.25]}},\n\
             {\"type\":\"Feature\",\"geometry\":{\"type\":\"Point\",\"coordinates\":[0.5,-0.25]},\
             \"properties\":{\"kind\":\"shore\",\"number\":8,\"class\":\"solid\",\"ratio\":0.3333,\"voxels\":3,\
             \"rigid_voxels\":1,\"center\":[0.5,-0.25]}},\n\
             {\"type\":\"Feature\",\"geometry\":{\"type\":\"Point\",\"coordinates\":[10.0,20.0]},\
             \"properties\":{\"kind\":\"docking site\",\"name\":\"B\",\"rank\":1,\"heading_deg\":90.0,\"width_m\":6.3,\
             \"class\":\"dense\",\"price\":1.1235,\"approach\":[10.0,15.5]}}\n\
             ]}\n"
        );
        let read: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(read["features"].as_array().map(Vec::len), Some(3));
        // RFC 7946 §7.1: forbidden members of a collection.
        for member in ["coordinates", "geometry", "geometries", "properties"] {
            assert!(read.get(member).is_none(), "{member}");
        }
    }

    #[test]
    fn with_a_fix_it_is_longitude_and_latitude() {
        let datum = Datum {
            latitude_deg: 38.5,
            longitude_deg: -9.1,
            altitude_m: 0.0,
        };
        let read: Value = serde_json::from_str(&text(&shores(Some(datum)))).unwrap();
        let reference = read["coordinate_reference"].as_str().unwrap();
        assert!(reference.starts_with("WGS-84"), "{reference}");
        assert!(read.get("crs").is_none(), "RFC 7946 §4");
        let site = &read["features"][2];
        // 10 m east and 20 m north; a second is 24.2313 m of longitude and 30.8350 m of latitude.
        let check = |place: &Value, expected: [f64; 2]| {
            for (number, expected) in place.as_array().unwrap().iter().zip(expected) {
                let error_deg = number.as_f64().unwrap() - expected;
                assert!(error_deg.abs() < 1e-8, "{number} {expected}");
            }
        };
        let (east_deg, north_deg) = (1.0 / 24.2313 / 3600.0, 1.0 / 30.8350 / 3600.0);
        let place = &site["geometry"]["coordinates"];
        check(place, [-9.1 + 10.0 * east_deg, 38.5 + 20.0 * north_deg]);
        assert_eq!(site["properties"]["bearing_deg"], json!(0.0));
        let ring = &read["features"][0]["geometry"]["coordinates"][0];
        check(&ring[1], [-9.1 + 0.75 * east_deg, 38.5 - 0.5 * north_deg]);
        assert_eq!(ring[0], ring[3]);
    }

    #[test]
    fn no_shores_are_an_empty_collection() {
        let read: Value = serde_json::from_str(&text(&Shores::default())).unwrap();
        assert_eq!(read["features"], json!([]));
    }
}
