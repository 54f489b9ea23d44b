//! Bags made by hand for tests, byte by byte.

/// A record out of its header fields and its data.
fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let mut header = Vec::new();
    for (name, value) in fields {
        header.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
        header.extend(name.as_bytes());
        header.push(b'=');
        header.extend(*value);
    }
    let mut record = (header.len() as u32).to_le_bytes().to_vec();
    record.extend(header);
    record.extend((data.len() as u32).to_le_bytes());
    record.extend(data);
    record
}

pub(super) fn message(conn: u32, time_s: u32, data: &[u8]) -> Vec<u8> {
    let time = [time_s.to_le_bytes(), [0; 4]].concat();
    let fields: [(&str, &[u8]); 3] = [("conn", &conn.to_le_bytes()), ("op", &[2]), ("time", &time)];
    record(&fields, data)
}

pub(super) fn connection(conn: u32, topic: &str, type_name: &str) -> Vec<u8> {
    let named = record(
        &[("topic", topic.as_bytes()), ("type", type_name.as_bytes())],
        &[],
    );
    let data = &named[4..named.len() - 4];
    let fields: [(&str, &[u8]); 3] = [
        ("conn", &conn.to_le_bytes()),
        ("op", &[7]),
        ("topic", topic.as_bytes()),
    ];
    record(&fields, data)
}

pub(super) fn index(conn: u32, count: u32) -> Vec<u8> {
    let fields: [(&str, &[u8]); 4] = [
        ("conn", &conn.to_le_bytes()),
        ("count", &count.to_le_bytes()),
        ("op", &[4]),
        ("ver", &1_u32.to_le_bytes()),
    ];
    record(&fields, &vec![0; count as usize * 12])
}

/// A chunk that holds `records`, packed as `compression` says.
pub(super) fn chunk(compression: &str, records: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let packed = match compression {
        "bz2" => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
            encoder.write_all(records).unwrap();
            encoder.finish().unwrap()
        }
        // As ROS does it: independent blocks, a checksum of the content.
        "lz4" => {
            let frame = lz4_flex::frame::FrameInfo::new()
                .block_size(lz4_flex::frame::BlockSize::Max64KB)
                .block_mode(lz4_flex::frame::BlockMode::Independent)
                .content_checksum(true);
            let mut encoder = lz4_flex::frame::FrameEncoder::with_frame_info(frame, Vec::new());
            encoder.write_all(records).unwrap();
            encoder.finish().unwrap()
        }
        _ => records.to_vec(),
    };
    let fields: [(&str, &[u8]); 3] = [
        ("compression", compression.as_bytes()),
        ("op", &[5]),
        ("size", &(records.len() as u32).to_le_bytes()),
    ];
    record(&fields, &packed)
}

/// A whole bag out of chunks and what else follows the header, without an index.
pub(super) fn bag(parts: &[Vec<u8>]) -> Vec<u8> {
    let fields: [(&str, &[u8]); 4] = [
        ("chunk_count", &[0; 4]),
        ("conn_count", &[0; 4]),
        ("index_pos", &[0; 8]),
        ("op", &[3]),
    ];
    [
        b"#ROSBAG V2.0\n".to_vec(),
        record(&fields, &[b' '; 50]),
        parts.concat(),
    ]
    .concat()
}
