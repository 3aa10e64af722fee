//! Names of places on a chain: links, their joints, and the bushes at them.
//!
//! Link i goes from joint i - 1 to joint i, within its own chain: its front joint has its number, its rear joint the
//! number of the link behind it. A bush or roller is named by its link, its end and its joint.

use super::frame::{Feature, Header, Impact};

/// The chains of a recording as closed loops of links.
pub struct Loops {
    ahead: Vec<u32>,
    behind: Vec<u32>,
    /// First link and number of links of each link's chain.
    chain: Vec<(u32, u32)>,
}

impl Loops {
    /// From the links of a header.
    pub fn new(header: &Header) -> Loops {
        let ahead: Vec<u32> = header.links.iter().map(|l| l.ahead).collect();
        let mut behind = vec![0; ahead.len()];
        for (link, next) in ahead.iter().enumerate() {
            if let Some(place) = behind.get_mut(*next as usize) {
                *place = link as u32;
            }
        }
        let mut chain = vec![(0, 1); ahead.len()];
        let mut start = 0;
        for (link, next) in ahead.iter().enumerate() {
            // The last link of a chain leads back to its first.
            if *next as usize <= link {
                chain[start..=link].fill((start as u32, (link + 1 - start) as u32));
                start = link + 1;
            }
        }
        Loops { ahead, behind, chain }
    }

    /// First link and number of links of a link's chain.
    pub fn of(&self, link: u32) -> (u32, u32) {
        self.chain.get(link as usize).copied().unwrap_or((0, 1))
    }

    /// The link ahead of a link.
    pub fn ahead(&self, link: u32) -> u32 {
        self.ahead.get(link as usize).copied().unwrap_or(link)
    }

    /// The link behind a link, whose number its rear joint has.
    pub fn behind(&self, link: u32) -> u32 {
        self.behind.get(link as usize).copied().unwrap_or(link)
    }

    /// The joint at which a part of a link sits; none for what lies between them.
    pub fn joint_at(&self, link: u32, feature: u32) -> Option<u32> {
        const FRONT: [Feature; 4] =
            [Feature::FrontBush, Feature::FrontRoller, Feature::FrontPlateEnd, Feature::FrontAbutment];
        const REAR: [Feature; 4] =
            [Feature::RearBush, Feature::RearRoller, Feature::RearPlateEnd, Feature::RearAbutment];
        let is_one = |of: [Feature; 4]| of.iter().any(|f| *f as u32 == feature);
        if is_one(FRONT) { Some(link) } else { is_one(REAR).then(|| self.behind(link)) }
    }

    /// The joint at which an impact strikes.
    pub fn joint(&self, impact: &Impact) -> Option<u32> {
        self.joint_at(impact.link, impact.feature)
    }
}

impl Header {
    /// Whether the recording holds several drives side by side, which cannot be run again.
    pub fn is_merged(&self) -> bool {
        self.drive_text.starts_with("# ---- ")
    }
}
