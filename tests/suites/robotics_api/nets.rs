//! Nets of the tests: those that the library sent for real motions, and small ones in its notation.

use rcc_tests::repository;

/// Returns a net that the library sent.
pub fn recorded(file: &str) -> String {
    let path = repository().join("tests/data/directionet").join(file);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A net without devices: `out_c` is its cancel, `out_go` what the application sets as `in_go`, `out_x` its time in seconds.
pub const IDLE: &str = "{1=Core::BooleanNetcommOut(inValue=2.outCancel,Key='_c',Value='false'),2=Cancel(),\
    3=Core::BooleanNetcommIn(Key='_go',Value='false'),4=Core::BooleanNetcommOut(inValue=3.outValue,Key='_go',Value='false'),\
    5=Core::Clock(Increment='1.0'),6=Core::DoubleNetcommOut(inValue=5.outValue,Key='_x',Value='0.0'),\
    7=Core::BooleanValue(Value='false'),outTerminate=7.outValue}";

/// As [`IDLE`], with `out_g`, which is true in one cycle only, between two samples of its monitor.
pub fn guarded() -> String {
    let guard = "8=Core::DoubleEquals(inFirst=5.outValue,Second='0.406',Epsilon='0.0005'),\
                 9=Core::BooleanNetcommOut(inValue=8.outValue,Key='_g',Value='false'),7=";
    IDLE.replacen("7=", guard, 1)
}

/// A net whose result `out_2` is true in its first cycle.
pub const AT_ONCE: &str = "{1=Core::BooleanNetcommOut(inValue=2.outValue,Key='_2',Value='false'),\
    2=Core::BooleanValue(Value='true'),3=Core::BooleanValue(Value='false'),outTerminate=3.outValue}";

/// A net that sets a digital output and is completed at once.
pub fn output(device: &str, port: usize, value: bool) -> String {
    format!(
        "{{1=Core::BooleanNetcommOut(inValue=2.outValue,Key='_2',Value='false'),2=Core::BooleanValue(Value='true'),\
         3=Core::BooleanValue(Value='false'),4=Core::BooleanValue(Value='{value}'),\
         5=IO::OutBool(inIO=4.outValue,DeviceID='{device}',Port='{port}',IO='false'),outTerminate=3.outValue}}"
    )
}

/// An evaluation of the measured positions of an arm.
pub fn joint_positions(device: &str, joints: usize) -> String {
    let joints = (0..joints).map(|axis| {
        format!(
            "m{axis}=RobotArm::JointMonitor(Robot='{device}',Axis='{axis}'),\
             o{axis}=Core::DoubleNetcommOut(inValue=m{axis}.outMeasuredPosition,Key='r{axis}',Value='0.0')"
        )
    });
    format!("{{{}}}", joints.collect::<Vec<_>>().join(","))
}

/// An evaluation of the pose of an arm's flange.
pub fn flange(device: &str, joints: usize) -> String {
    let set = (0..joints).map(|axis| {
        let before = axis.checked_sub(1).map_or("z".to_owned(), |before| format!("a{before}"));
        format!(
            "m{axis}=RobotArm::JointMonitor(Robot='{device}',Axis='{axis}'),\
             a{axis}=Core::DoubleArraySet(inArray={before}.outArray,inValue=m{axis}.outMeasuredPosition,\
             Size='{joints}',Index='{axis}'),"
        )
    });
    let last = joints - 1;
    format!(
        "{{{}z=Core::DoubleArray(Size='{joints}'),k=ArmKinematics::Kin(inJoints=a{last}.outArray,Robot='{device}'),\
         o=World::FrameNetcommOut(inValue=k.outFrame,Key='f')}}",
        set.collect::<String>()
    )
}

/// Returns the values of an evaluation by key.
pub fn values(document: &str) -> Vec<(String, String)> {
    let rows = document.split("<data key=\"").skip(1);
    let rows = rows.filter_map(|row| {
        let (key, rest) = row.split_once("\">")?;
        Some((key.to_owned(), rest.split_once("</data>")?.0.to_owned()))
    });
    rows.collect()
}
