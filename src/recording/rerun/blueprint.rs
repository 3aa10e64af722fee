//! Initial layout of an `.rrd` in the viewer: the whole drive from the front, a close-up of every sprocket where the
//! chain runs on, curves, tables and events. It is written message by message, because the crate's builder (0.36)
//! cannot set cameras and generates random ids.

use super::rows::CONTACTS_PAGE;
use super::scene::legend_entity;
use anyhow::{Context, Result};
use rerun::blueprint::components::{ContainerKind, LinkAxis, LoopMode, PanelState, PlayState};
use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::external::re_sdk_types::blueprint::archetypes::{
    Background, ContainerBlueprint, DataframeQuery, EyeControls3D, LineGrid3D, PanelBlueprint, TimeAxis,
    TimePanelBlueprint, ViewBlueprint, ViewContents, ViewportBlueprint,
};
use rerun::external::re_sdk_types::blueprint::components::{BackgroundKind, Eye3DKind};
use rerun::external::re_sdk_types::blueprint::datatypes::{ComponentColumnSelector, SelectedColumns};
use rerun::external::re_sdk_types::components::{Plane3D, Position3D, Vector3D, Visible};
use rerun::external::re_sdk_types::datatypes::{AbsoluteTimeRange, Utf8, Uuid};
use rerun::log::LogMsg;
use rerun::{AsComponents, Color, RecordingStream, RecordingStreamBuilder};

/// Simulated seconds per second of playback.
const PLAYBACK_SPEED: f64 = 0.005;

/// Half of the viewer's vertical field of view, which is 55 degrees.
const HALF_FIELD_OF_VIEW_RAD: f64 = 0.48;

/// A rectangle to be shown [mm].
#[derive(Clone, Debug)]
pub struct ViewRect {
    pub name: String,
    pub centre: [f64; 2],
    pub width: f64,
    pub height: f64,
    /// Whether there is room for labels.
    pub is_near: bool,
}

impl ViewRect {
    /// Half of the width and of the height that is seen in a pane of this ratio of width to height.
    pub fn half_seen(&self, aspect: f64) -> [f64; 2] {
        let half_height = 0.5 * self.height.max(self.width / aspect);
        [aspect * half_height, half_height]
    }
}

/// Pictures that share a tab: rows from top to bottom.
#[derive(Clone, Debug)]
pub struct PictureTab {
    pub name: String,
    pub rows: Vec<Vec<ViewRect>>,
}

/// What the viewer shows first.
#[derive(Clone, Debug)]
pub struct FirstView {
    /// The first one is in front. Views are counted through all tabs, for their legends.
    pub tabs: Vec<PictureTab>,
    pub play: PlayState,
    /// Time at which it stands [ns]; None: at the beginning.
    pub stands_at_ns: Option<i64>,
    /// Title and entity of the curves of the sensors of each unit.
    pub sensors: Vec<(String, String)>,
}

impl PictureTab {
    /// Approximate ratio of width to height of the panes in a row.
    fn aspect(&self, row: &[ViewRect]) -> f64 {
        PICTURES_ASPECT * self.rows.len() as f64 / row.len() as f64
    }
}

impl FirstView {
    /// Pictures in the order of their legends, each with the ratio of width to height of its pane.
    pub fn pictures(&self) -> impl Iterator<Item = (&ViewRect, f64)> {
        let of_tab = |tab: &PictureTab| -> Vec<f64> {
            tab.rows.iter().flat_map(|row| row.iter().map(|_| tab.aspect(row))).collect()
        };
        self.tabs.iter().flat_map(move |tab| tab.rows.iter().flatten().zip(of_tab(tab)))
    }
}

/// Width over height of all pictures of a tab together.
const PICTURES_ASPECT: f64 = 1.1;

/// Adds the layout to the recording and activates it.
pub fn send(stream: &RecordingStream, recording: &str, first: &FirstView) -> Result<()> {
    let (layout, storage) = RecordingStreamBuilder::new(super::APPLICATION)
        .recording_id(format!("{recording}-layout"))
        .enabled(true)
        .blueprint()
        .memory()?;
    layout.disable_timeline("log_time");
    layout.disable_timeline("log_tick");
    layout.set_time_sequence("blueprint", 0);
    log_layout(&mut ViewerLayout { stream: layout, ids: 0, pictures: 0 }, first)?;
    let messages = storage.take();
    let blueprint_id = messages.iter().find_map(|message| match message {
        LogMsg::SetStoreInfo(info) => Some(info.info.store_id.clone()),
        LogMsg::ArrowMsg(..) | LogMsg::BlueprintActivationCommand(_) => None,
    });
    let blueprint_id = blueprint_id.context("the layout has no store")?;
    stream.send_blueprint(messages, BlueprintActivationCommand { blueprint_id, make_active: true, make_default: true });
    Ok(())
}

fn log_layout(layout: &mut ViewerLayout, first: &FirstView) -> Result<()> {
    let mut pictures = Vec::new();
    for tab in &first.tabs {
        let mut rows = Vec::new();
        for row in &tab.rows {
            let aspect = tab.aspect(row);
            let mut cameras = Vec::new();
            for look in row {
                cameras.push((layout.camera(look, aspect)?, 1.0));
            }
            rows.push((layout.line(ContainerKind::Horizontal, &tab.name, cameras)?, 1.0));
        }
        pictures.push(layout.line(ContainerKind::Vertical, &tab.name, rows)?);
    }
    let left = tabs(layout, "pictures", &pictures)?;
    let force = layout.curves("largest contact force", "/plots/largest_contact_force")?;
    let tension = layout.curves("tension of joints", "/plots/joint_tension")?;
    let speed = layout.curves("speed of sprockets", "/plots/speed")?;
    let count = layout.curves("number of contacts", "/plots/contacts")?;
    let lost = layout.curves("energy lost", "/plots/energy_lost")?;
    let energy = layout.curves("energy and work", "/plots/energy")?;
    let error = layout.curves("energy error", "/plots/energy_error")?;
    let readme = layout.view("TextDocument", "read me", "/readme")?;
    let drive_file = layout.view("TextDocument", "drive file", "/drive_file")?;
    let page = layout.view("TextDocument", "contacts now", &format!("/{CONTACTS_PAGE}"))?;
    let table = layout.view("Dataframe", "contacts over time", "/state/contacts")?;
    layout.property(&table, "DataframeQuery", &contact_columns())?;
    let events = layout.view("TextLog", "events", "/events")?;
    let forces = tabs(layout, "forces", &[force, count])?;
    let mut second = vec![tension, speed, lost, energy, error];
    for (place, (title, entity)) in first.sensors.iter().enumerate() {
        second.insert(place, layout.curves(title, entity)?);
    }
    let second = tabs(layout, "tensions", &second)?;
    let third = tabs(layout, "tables", &[page, table, readme, drive_file])?;
    let right = layout.container(
        ContainerKind::Vertical,
        "numbers",
        &[(forces, 1.0), (second, 1.0), (third, 1.0), (events, 0.7)],
    )?;
    let root = layout.container(ContainerKind::Horizontal, "all", &[(left, 1.9), (right, 1.0)])?;
    layout.panels(&root, first)
}

/// The columns of the table of contacts, the most important on the left.
fn contact_columns() -> DataframeQuery {
    let names = [
        "normal_force_n",
        "penetration_m",
        "link",
        "feature",
        "body",
        "tooth",
        "segment",
        "approach_speed_m_s",
        "normal_speed_m_s",
        "tangential_speed_m_s",
        "tangential_force_n",
        "stick",
        "age_s",
    ];
    let column = |name: &str| ComponentColumnSelector::new(&"/state/contacts".into(), format!("contact:{name}"));
    let selected = SelectedColumns {
        time_columns: ["sim_time", "step"].map(Utf8::from).to_vec(),
        component_columns: names.map(column).to_vec(),
    };
    DataframeQuery::new().with_timeline("sim_time").with_auto_scroll(true).with_select(selected)
}

fn tabs(layout: &mut ViewerLayout, name: &str, views: &[LayoutNode]) -> Result<LayoutNode> {
    let views: Vec<(LayoutNode, f32)> = views.iter().map(|view| (view.clone(), 1.0)).collect();
    layout.container(ContainerKind::Tabs, name, &views)
}

/// A view or a container in the layout's store.
#[derive(Clone)]
struct LayoutNode {
    path: String,
    id: [u8; 16],
}

struct ViewerLayout {
    stream: RecordingStream,
    /// Number of ids given.
    ids: u8,
    /// Number of pictures, for their legends.
    pictures: usize,
}

impl ViewerLayout {
    fn place(&mut self, kind: &str) -> LayoutNode {
        self.ids += 1;
        let mut id = *b"pitchline\0\0\0\0\0\0\0";
        // Version 4, variant 1, as readers of UUIDs expect.
        (id[6], id[8], id[15]) = (0x40 | (id[6] & 0x0f), 0x80 | (id[8] & 0x3f), self.ids);
        let hex: String = id.iter().map(|byte| format!("{byte:02x}")).collect();
        let text = [&hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..]].join("-");
        LayoutNode { path: format!("{kind}/{text}"), id }
    }

    fn view(&mut self, class: &str, name: &str, origin: &str) -> Result<LayoutNode> {
        self.view_of(class, name, origin, &["$origin/**"])
    }

    fn view_of(&mut self, class: &str, name: &str, origin: &str, contents: &[&str]) -> Result<LayoutNode> {
        let placed = self.place("view");
        self.property(&placed, "ViewContents", &ViewContents::new(contents.iter().copied()))?;
        let view = ViewBlueprint::new(class).with_display_name(name).with_space_origin(origin);
        self.stream.log(placed.path.as_str(), &view)?;
        Ok(placed)
    }

    fn property(&self, view: &LayoutNode, name: &str, property: &dyn AsComponents) -> Result<()> {
        Ok(self.stream.log(format!("{}/{name}", view.path), property)?)
    }

    /// A view from the front; `aspect` is the approximate ratio of width to height of its pane.
    fn camera(&mut self, look: &ViewRect, aspect: f64) -> Result<LayoutNode> {
        let legend = format!("+ /{}/**", legend_entity(self.pictures));
        self.pictures += 1;
        let labels = format!("{} /contacts/labels", if look.is_near { '+' } else { '-' });
        let shown = ["+ /chain/**", "+ /bodies/**", "+ /joints/**", "+ /contacts/**", &labels, &legend];
        let view = self.view_of("3D", &look.name, "/", &shown)?;
        let [_, half_height] = look.half_seen(aspect);
        let distance = half_height / libm::tan(HALF_FIELD_OF_VIEW_RAD);
        let [x, y] = look.centre.map(|v| v as f32);
        let eye = EyeControls3D::new()
            .with_kind(Eye3DKind::Orbital)
            .with_position(Position3D::new(x, y, distance as f32))
            .with_look_target(Position3D::new(x, y, 0.0))
            .with_eye_up(Vector3D::from([0.0, 1.0, 0.0]));
        self.property(&view, "EyeControls3D", &eye)?;
        let background = Background::new(BackgroundKind::SolidColor).with_color(Color::from_rgb(24, 26, 30));
        self.property(&view, "Background", &background)?;
        let grid = LineGrid3D::new()
            .with_visible(Visible::from(true))
            .with_plane(Plane3D::new([0.0, 0.0, 1.0], -1.0))
            .with_spacing(10.0)
            .with_stroke_width(1.0)
            .with_color(Color::from_rgb(44, 48, 56));
        self.property(&view, "LineGrid3D", &grid)?;
        Ok(view)
    }

    fn curves(&mut self, name: &str, origin: &str) -> Result<LayoutNode> {
        let view = self.view("TimeSeries", name, origin)?;
        self.property(&view, "TimeAxis", &TimeAxis::new().with_link(LinkAxis::LinkToGlobal))?;
        Ok(view)
    }

    /// Its only part, or a container of several.
    fn line(&mut self, kind: ContainerKind, name: &str, mut parts: Vec<(LayoutNode, f32)>) -> Result<LayoutNode> {
        match parts.pop() {
            Some((only, _)) if parts.is_empty() => Ok(only),
            last => {
                parts.extend(last);
                self.container(kind, name, &parts)
            }
        }
    }

    /// A container; `parts` with their shares of its length.
    fn container(&mut self, kind: ContainerKind, name: &str, parts: &[(LayoutNode, f32)]) -> Result<LayoutNode> {
        let placed = self.place("container");
        let mut container = ContainerBlueprint::new(kind)
            .with_display_name(name)
            .with_contents(parts.iter().map(|(p, _)| p.path.as_str()));
        let shares = parts.iter().map(|(_, share)| *share);
        match kind {
            ContainerKind::Horizontal => container = container.with_col_shares(shares),
            ContainerKind::Vertical => container = container.with_row_shares(shares),
            ContainerKind::Tabs => container = container.with_active_tab(parts[0].0.path.as_str()),
            ContainerKind::Grid => {}
        }
        self.stream.log(placed.path.as_str(), &container)?;
        Ok(placed)
    }

    fn panels(&self, root: &LayoutNode, first: &FirstView) -> Result<()> {
        let viewport = ViewportBlueprint::new()
            .with_root_container(Uuid { bytes: root.id })
            .with_auto_layout(false)
            .with_auto_views(false);
        self.stream.log("viewport", &viewport)?;
        let mut time = TimePanelBlueprint::new()
            .with_timeline("sim_time")
            .with_playback_speed(PLAYBACK_SPEED)
            .with_play_state(first.play)
            .with_state(PanelState::Collapsed);
        if let Some(at_ns) = first.stands_at_ns {
            // A layout cannot set the time (0.36). A viewer that plays in a loop of no length comes to this time and stays there.
            let only = AbsoluteTimeRange { min: at_ns.into(), max: at_ns.into() };
            time =
                time.with_play_state(PlayState::Playing).with_loop_mode(LoopMode::Selection).with_time_selection(only);
        }
        self.stream.log("time_panel", &time)?;
        for panel in ["selection_panel", "blueprint_panel"] {
            self.stream.log(panel, &PanelBlueprint::new().with_state(PanelState::Collapsed))?;
        }
        Ok(())
    }
}
