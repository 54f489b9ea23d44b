//! Every message: any bytes are an error, or a message that survives its own encoding.
#![no_main]

use libfuzzer_sys::fuzz_target;
use protocol::message::{
    Answer, Changes, Digests, DigestsRequest, Event, Info, MapHead, Pong, Pose, Scan, ShoresReply,
    ShoresRequest, Status, TilesReply, TilesRequest, TrajectoryPart,
    TrajectoryRequest, View, VoxelsReply, VoxelsRequest,
};
use protocol::wire::{decode, encode};
use serde::Serialize;
use serde::de::DeserializeOwned;

fn check<T: Serialize + DeserializeOwned>(bytes: &[u8]) {
    if let Ok((header, body)) = decode::<T>(bytes) {
        // Not the received bytes: varints can be longer than necessary. And bytes, not bodies: NaN
        // ≠ NaN.
        let once = encode(&header, &body).unwrap();
        assert!(once.len() <= bytes.len());
        let (header, body) = decode::<T>(&once).unwrap();
        assert_eq!(encode(&header, &body).unwrap(), once);
    }
}

fuzz_target!(|bytes: &[u8]| {
    check::<Info>(bytes);
    check::<Pong>(bytes);
    check::<Pose>(bytes);
    check::<Status>(bytes);
    check::<Event>(bytes);
    check::<MapHead>(bytes);
    check::<View>(bytes);
    check::<Changes>(bytes);
    check::<TilesRequest>(bytes);
    check::<TilesReply>(bytes);
    check::<DigestsRequest>(bytes);
    check::<Digests>(bytes);
    check::<ShoresRequest>(bytes);
    check::<ShoresReply>(bytes);
    check::<VoxelsRequest>(bytes);
    check::<VoxelsReply>(bytes);
    check::<TrajectoryRequest>(bytes);
    check::<TrajectoryPart>(bytes);
    if let Ok((_, scan)) = decode::<Scan>(bytes)
        && let Some(points) = scan.points_m()
    {
        assert!(points.iter().flatten().all(|metres| metres.is_finite()));
    }
    check::<Scan>(bytes);
    check::<Answer>(bytes);
});
