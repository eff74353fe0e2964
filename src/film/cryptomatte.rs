//! Cryptomatte: for each pixel the identifiers of what it shows, each with its coverage (Friedman and Jones
//! 2015; specification 1.2.0).

use std::collections::BTreeMap;

use super::exr::Channel;

/// Identifiers of a pixel that are stored.
const RANKS: usize = 6;

/// Returns the 32-bit MurmurHash3 of a name.
fn hash_of(name: &str) -> u32 {
    // Reading from memory does not fail.
    murmur3::murmur3_32(&mut name.as_bytes(), 0).unwrap_or_default()
}

/// Returns the identifier of a name: the bits of its hash as a float that is neither denormal nor infinite nor
/// NaN.
#[must_use]
pub fn identifier(name: &str) -> f32 {
    let hash = hash_of(name);
    let exponent = hash >> 23 & 255;
    f32::from_bits(if exponent == 0 || exponent == 255 { hash ^ 1 << 23 } else { hash })
}

/// Returns the channels of a layer such as `CryptoObject`, and the attributes that describe it. `pixels` are
/// indices of names with their coverage, the largest first.
#[must_use]
pub fn layer(name: &str, names: &[String], pixels: &[Vec<(usize, f32)>]) -> (Vec<Channel>, Vec<(String, String)>) {
    let identifiers: Vec<f32> = names.iter().map(|name| identifier(name)).collect();
    let channel = |n: usize| {
        let value = |pixel: &Vec<(usize, f32)>| {
            let ranked = pixel.get(n / 2).filter(|_| n / 2 < RANKS);
            ranked.map_or(0.0, |&(id, coverage)| if n.is_multiple_of(2) { identifiers[id] } else { coverage })
        };
        let name = format!("{name}{:02}.{}", n / 4, ["R", "G", "B", "A"][n % 4]);
        Channel { name, values: pixels.iter().map(value).collect() }
    };
    let hexadecimal = |name: &String| (name.clone(), format!("{:08x}", identifier(name).to_bits()));
    let manifest: BTreeMap<String, String> = names.iter().map(hexadecimal).collect();
    let key = format!("{:08x}", hash_of(name));
    let attributes = [
        ("name", name.to_owned()),
        ("hash", "MurmurHash3_32".to_owned()),
        ("conversion", "uint32_to_float32".to_owned()),
        ("manifest", serde_json::to_string(&manifest).unwrap_or_default()),
    ];
    let attributes = attributes.map(|(what, text)| (format!("cryptomatte/{}/{what}", &key[..7]), text));
    ((0..2 * RANKS).map(channel).collect(), attributes.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_those_of_the_specification() {
        // MurmurHash3_x86_32 of "hello" with seed 0 is 0x248bfa47.
        assert_eq!(identifier("hello").to_bits(), 0x248b_fa47);
        for n in 0..20_000 {
            assert!(identifier(&n.to_string()).is_normal(), "{n}");
        }
    }

    #[test]
    fn a_layer_has_ranks_of_identifiers_and_coverage() {
        let names = ["a", "b"].map(str::to_owned);
        let (channels, attributes) = layer("CryptoObject", &names, &[vec![(1, 0.75), (0, 0.25)], vec![]]);
        let named: Vec<_> = channels.iter().map(|channel| channel.name.as_str()).collect();
        assert_eq!(
            (named.len(), named[0], named[3], named[4]),
            (12, "CryptoObject00.R", "CryptoObject00.A", "CryptoObject01.R")
        );
        let values: Vec<f32> = channels.iter().take(5).map(|channel| channel.values[0]).collect();
        assert_eq!(values, [identifier("b"), 0.75, identifier("a"), 0.25, 0.0]);
        assert!(channels.iter().all(|channel| channel.values[1] == 0.0));
        assert!(attributes[0].0.starts_with("cryptomatte/") && attributes[3].1.contains("\"a\":\""), "{attributes:?}");
    }
}
