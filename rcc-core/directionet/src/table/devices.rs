//! Devices, and types that only a library of the predecessor has, one row per type; `docs/from-the-predecessor.md` is
//! generated from it. Used by the loader's threads.

use super::Counterpart::{Net, None, Special};
use super::NullReading::{Last, Null};
use super::PrimitiveClass::{A, M, S};
use super::{ConversionRow, NoCounterpart, SpecialConversion};

#[rustfmt::skip] // A row a type, readable as a table.
pub(super) const ROWS: &[ConversionRow] = &[
    ConversionRow::new("IO::InBool", M, "", "outIO:bool", "DeviceID:string= Port:int=0")
        .to(Last, Net("{outIO=DigitalInput(device=parent.DeviceID,channel=parent.Port).out}"))
        .note("`Port` counts the channels of the kind in the order of the cell's configuration"),
    ConversionRow::new("IO::InReal", M, "", "outIO:double", "DeviceID:string= Port:int=0")
        .to(Last, Net("{outIO=AnalogInput(device=parent.DeviceID,channel=parent.Port).out}"))
        .note("`Port` counts the channels of the kind in the order of the cell's configuration"),
    ConversionRow::new("IO::OutBool", A, "inIO:bool", "", "DeviceID:string= Port:int=0 IO:bool=false")
        .to(Null, Net("{o=DigitalOutput(device=parent.DeviceID,channel=parent.Port,in=parent.inIO)}"))
        .note("null commands nothing; the channel belongs to the net"),
    ConversionRow::new("IO::OutBoolSensor", M, "", "outIO:bool", "DeviceID:string= Port:int=0")
        .to(Last, Net("{outIO=DigitalOutputState(device=parent.DeviceID,channel=parent.Port).out}"))
        .note("`Port` counts the channels of the kind in the order of the cell's configuration; null before the first command of a channel that holds"),
    ConversionRow::new("IO::OutReal", A, "inIO:double", "", "DeviceID:string= Port:int=0 IO:double=0")
        .to(Null, Net("{o=AnalogOutput(device=parent.DeviceID,channel=parent.Port,in=parent.inIO)}"))
        .note("null commands nothing; the channel belongs to the net"),
    ConversionRow::new("IO::OutRealSensor", M, "", "outIO:double", "DeviceID:string= Port:int=0")
        .to(Last, Net("{outIO=AnalogOutputState(device=parent.DeviceID,channel=parent.Port).out}"))
        .note("`Port` counts the channels of the kind in the order of the cell's configuration; null before the first command of a channel that holds"),
    ConversionRow::new("RobotArm::JointMonitor", M, "", "outCommandedAcceleration:double outCommandedPosition:double outCommandedVelocity:double outError:int outMeasuredAcceleration:double outMeasuredPosition:double outMeasuredVelocity:double", "Robot:string= Axis:int=0")
        .to(Last, Special(SpecialConversion::JointMonitor))
        .note("elements of one `JointState` for all axes (`position`, or `hold` for the commanded one) and of one `JointVelocity`; accelerations have no counterpart (`Derivative`), `outError` is 0, because such an error ends the net with a fault"),
    ConversionRow::new("RobotArm::JointPosition", A, "inPosition:double", "outError:int outErrorConcurrentAccess:bool outErrorIllegalPosition:bool outErrorJointFailed:bool", "Robot:string= Axis:int=0")
        .to(Null, Special(SpecialConversion::JointPosition))
        .note("one `JointPositionCommand` for all axes of the robot; null commands nothing; the errors are constants, because such an error ends the net with a fault"),
    ConversionRow::new("RobotArm::ToolParameters", A, "inCOM:Vector inMOI:Vector inMass:double", "outCompleted:bool outError:int", "Robot:string= Axis:int=0 Mass:double=0 COM:Vector={x:0,y:0,z:0} MOI:Vector={x:0,y:0,z:0}")
        .to(Last, None(NoCounterpart::Elsewhere))
        .note("the controller's own program sets tool and load; RCC uses them in `WrenchCompensation` and in poses of the tool"),
    ConversionRow::new("ArmKinematics::InvKin", A, "inFrame*:Frame inHintJoints*:double[]", "outJoints:double[]", "Robot:string=")
        .to(Last, Special(SpecialConversion::InvKin))
        .note("`InverseKinematics` if the hint is the robot's own position, which keeps arm angle and branch of the start; else `InverseKinematicsNear`"),
    ConversionRow::new("ArmKinematics::Kin", A, "inJoints*:double[]", "outFrame:Frame", "Robot:string=")
        .to(Last, Net("{outFrame=ForwardKinematics(device=parent.Robot,joints=parent.inJoints).pose}")),
    ConversionRow::new("CartesianPosition::CartesianMonitor", M, "", "outCommandedPosition:Frame outCommandedVelocity:Twist outError:int outMeasuredPosition:Frame outMeasuredVelocity:Twist", "Robot:string=")
        .to(Last, Net("{s=JointState(device=parent.Robot),v=JointVelocity(device=parent.Robot),outMeasuredPosition=ForwardKinematics(device=parent.Robot,joints=s.position).pose,outCommandedPosition=ForwardKinematics(device=parent.Robot,joints=s.hold).pose,outMeasuredVelocity=VelocityKinematics(device=parent.Robot,joints=s.position,velocity=v.velocity).twist,outCommandedVelocity=VelocityKinematics(device=parent.Robot,joints=s.hold,velocity=v.commanded).twist}"))
        .note("for arms; `outError` has no counterpart, because such an error ends the net with a fault"),
    ConversionRow::new("CartesianPosition::CartesianPosition", M, "inPosition*:Frame", "outError:int outErrorConcurrentAccess:bool outErrorDeviceFailed:bool outErrorIllegalPosition:bool", "Robot:string=")
        .to(Null, Net("{c=JointPositionCommand(device=parent.Robot,position=InverseKinematics(device=parent.Robot,pose=parent.inPosition).joints)}"))
        .note("for arms, by inverse kinematics; null commands nothing; the errors have no counterpart, because they end the net with a fault"),
    ConversionRow::new("RobotBase::BaseMonitor", M, "", "outCmdVel:Twist outError:int outPos:Frame outVel:Twist", "Robot:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for mobile bases"),
    ConversionRow::new("RobotBase::BaseVelocity", A, "inVel*:Twist", "outError:int outErrorBaseFailed:bool outErrorConcurrentAccess:bool outErrorIllegalVelocity:bool", "Robot:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for mobile bases"),
    ConversionRow::new("RobotBase::OmnidirectionalBaseController", M, "inDest:Frame inPos:Frame inVel:Twist", "outCompleted:bool outVel:Twist", "velX:double=0.25 velY:double=0.25 velYaw:double=0.3 pX:double=3 pY:double=3 pYaw:double=3")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for mobile bases"),
    ConversionRow::new("RobotBase::WheelMonitor", M, "", "outPos:double outVel:double", "Robot:string= Wheel:int=0")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for mobile bases"),
    ConversionRow::new("KUKA::IIWA::CartSinImpParameters", A, "inAmplitude:Wrench inFrequency:Wrench", "", "Robot:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the iiwa's own control modes"),
    ConversionRow::new("KUKA::LWR::CartImpParameters", A, "inAddTorque:Wrench inDamping:Wrench inStiffness:Wrench", "", "Robot:string=")
        .to(Last, None(NoCounterpart::Elsewhere))
        .note("use `CartesianImpedanceCommand`, which commands position and springs together"),
    ConversionRow::new("KUKA::LWR::ControlMode", A, "inStrategy:int", "outCompleted:bool outError:int", "Robot:string=")
        .to(Last, None(NoCounterpart::Elsewhere))
        .note("the controller's program chooses the mode before command mode; START refuses a net for a different one"),
    ConversionRow::new("KUKA::LWR::FMonitor", M, "", "outTcpFx:double outTcpFy:double outTcpFz:double outTcpTx:double outTcpTy:double outTcpTz:double", "Robot:string=")
        .to(Last, Net("{f=ForceTorque(device=parent.Robot),outTcpFx=f.fx,outTcpFy=f.fy,outTcpFz=f.fz,outTcpTx=f.tx,outTcpTy=f.ty,outTcpTz=f.tz}")),
    ConversionRow::new("KUKA::LWR::FTMonitor", M, "", "outMsrJ1:double outMsrJ2:double outMsrJ3:double outMsrJ4:double outMsrJ5:double outMsrJ6:double outMsrJ7:double outEstJ1:double outEstJ2:double outEstJ3:double outEstJ4:double outEstJ5:double outEstJ6:double outEstJ7:double outTcpFx:double outTcpFy:double outTcpFz:double outTcpTx:double outTcpTy:double outTcpTz:double", "Robot:string=")
        .to(Last, Net("{f=ForceTorque(device=parent.Robot),j=JointState(device=parent.Robot),outMsrJ1=At(of=j.torque,index='0').x,outEstJ1=At(of=j.external_torque,index='0').x,outMsrJ2=At(of=j.torque,index='1').x,outEstJ2=At(of=j.external_torque,index='1').x,outMsrJ3=At(of=j.torque,index='2').x,outEstJ3=At(of=j.external_torque,index='2').x,outMsrJ4=At(of=j.torque,index='3').x,outEstJ4=At(of=j.external_torque,index='3').x,outMsrJ5=At(of=j.torque,index='4').x,outEstJ5=At(of=j.external_torque,index='4').x,outMsrJ6=At(of=j.torque,index='5').x,outEstJ6=At(of=j.external_torque,index='5').x,outMsrJ7=At(of=j.torque,index='6').x,outEstJ7=At(of=j.external_torque,index='6').x,outTcpFx=f.fx,outTcpFy=f.fy,outTcpFz=f.fz,outTcpTx=f.tx,outTcpTy=f.ty,outTcpTz=f.tz}")),
    ConversionRow::new("KUKA::LWR::InvKin", A, "inFrame*:Frame inHintJ1*:double inHintJ2*:double inHintJ3*:double inHintJ4*:double inHintJ5*:double inHintJ6*:double inHintJ7*:double inNullspaceJ1:double inNullspaceJ2:double inNullspaceJ3:double inNullspaceJ4:double inNullspaceJ5:double inNullspaceJ6:double inNullspaceJ7:double", "outJ1:double outJ2:double outJ3:double outJ4:double outJ5:double outJ6:double outJ7:double", "Strategy:int=1 Robot:string=")
        .to(Last, Net("{i=InverseKinematicsNear(device=parent.Robot,pose=parent.inFrame,arm_angle=ArmAngle(device=parent.Robot,joints=List(j1=Else(link=parent.inNullspaceJ1,otherwise=parent.inHintJ1).x,j2=Else(link=parent.inNullspaceJ2,otherwise=parent.inHintJ2).x,j3=Else(link=parent.inNullspaceJ3,otherwise=parent.inHintJ3).x,j4=Else(link=parent.inNullspaceJ4,otherwise=parent.inHintJ4).x,j5=Else(link=parent.inNullspaceJ5,otherwise=parent.inHintJ5).x,j6=Else(link=parent.inNullspaceJ6,otherwise=parent.inHintJ6).x,j7=Else(link=parent.inNullspaceJ7,otherwise=parent.inHintJ7).x).x).angle,hint=List(j1=parent.inHintJ1,j2=parent.inHintJ2,j3=parent.inHintJ3,j4=parent.inHintJ4,j5=parent.inHintJ5,j6=parent.inHintJ6,j7=parent.inHintJ7).x),outJ1=At(of=i.joints,index='0').x,outJ2=At(of=i.joints,index='1').x,outJ3=At(of=i.joints,index='2').x,outJ4=At(of=i.joints,index='3').x,outJ5=At(of=i.joints,index='4').x,outJ6=At(of=i.joints,index='5').x,outJ7=At(of=i.joints,index='6').x}"))
        .note("the arm angle is kept exactly, whatever `Strategy` says"),
    ConversionRow::new("KUKA::LWR::JointImpParameters", A, "inAddTorque:double inDamping:double inStiffness:double", "", "Robot:string= Axis:int=0")
        .to(Last, None(NoCounterpart::Elsewhere))
        .note("use `JointImpedanceCommand`, which commands position and springs together"),
    ConversionRow::new("KUKA::LWR::Kin", A, "inJ1*:double inJ2*:double inJ3*:double inJ4*:double inJ5*:double inJ6*:double inJ7*:double", "outAlpha:double outFrame:Frame", "Robot:string=")
        .to(Last, Net("{outFrame=ForwardKinematics(device=parent.Robot,joints=List(j1=parent.inJ1,j2=parent.inJ2,j3=parent.inJ3,j4=parent.inJ4,j5=parent.inJ5,j6=parent.inJ6,j7=parent.inJ7).x).pose,outAlpha=ArmAngle(device=parent.Robot,joints=List(j1=parent.inJ1,j2=parent.inJ2,j3=parent.inJ3,j4=parent.inJ4,j5=parent.inJ5,j6=parent.inJ6,j7=parent.inJ7).x).angle}")),
    ConversionRow::new("KUKA::LWR::TMonitor", M, "", "outEst:double outMsr:double", "Robot:string= Axis:int=0")
        .to(Last, Net("{j=JointState(device=parent.Robot),outMsr=At(of=j.torque,index=parent.Axis).x,outEst=At(of=j.external_torque,index=parent.Axis).x}")),
    ConversionRow::new("KUKA::LWR::ToolParameters", A, "inCOM:Frame inMOI:Vector inMass:double inTCP:Frame", "outCompleted:bool outError:int", "robot:string=")
        .to(Last, None(NoCounterpart::Elsewhere))
        .note("the controller's own program sets tool and load; RCC uses them in `WrenchCompensation` and in poses of the tool"),
    ConversionRow::new("KUKA::LWR::VelKin", A, "inJ1*:double inJ2*:double inJ3*:double inJ4*:double inJ5*:double inJ6*:double inJ7*:double inV1*:double inV2*:double inV3*:double inV4*:double inV5*:double inV6*:double inV7*:double", "outTwist:Twist outVAlpha:double", "Robot:string=")
        .to(Last, Net("{outTwist=VelocityKinematics(device=parent.Robot,joints=List(j1=parent.inJ1,j2=parent.inJ2,j3=parent.inJ3,j4=parent.inJ4,j5=parent.inJ5,j6=parent.inJ6,j7=parent.inJ7).x,velocity=List(j1=parent.inV1,j2=parent.inV2,j3=parent.inV3,j4=parent.inV4,j5=parent.inV5,j6=parent.inV6,j7=parent.inV7).x).twist}"))
        .note("`outVAlpha` has no counterpart (`Derivative` of the arm angle)"),
    ConversionRow::new("KUKA:LWR::ToolParameters", A, "inCOM:Frame inMOI:Vector inMass:double inTCP:Frame", "outCompleted:bool outError:int", "robot:string=")
        .to(Last, None(NoCounterpart::Elsewhere))
        .note("the controller's own program sets tool and load; RCC uses them in `WrenchCompensation` and in poses of the tool"),
    ConversionRow::new("KUKA::youBot::ArmControlStrategy", A, "inController:int", "outSuccess:bool", "Robot:string= Controller:int=0")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the youBot"),
    ConversionRow::new("KUKA::youBot::Gripper", A, "", "outCompleted:bool", "Distance:double=0 Robot:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the youBot"),
    ConversionRow::new("KUKA::youBot::GripperMonitor", M, "", "outDistance:double", "Robot:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the youBot"),
    ConversionRow::new("KUKA::youBot::JointImpParameters", A, "inAddTorque:double inDamping:double inMaxTorque:double inStiffness:double", "outSuccess:bool", "Robot:string= Stiffness:double=0 Damping:double=0 AddTorque:double=0 MaxTorque:double=0 JointIndex:int=0")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the youBot"),
    ConversionRow::new("KUKA::youBot::PalletizingProject", M, "inFlange*:Frame inMotionCenter:Frame", "outValue:Frame", "")
        .to(Last, None(NoCounterpart::Device))
        .note("made for the youBot's arm of five joints, for which there is no driver"),
    ConversionRow::new("KUKA::youBot::PositionPreservingProject", M, "inFlange*:Frame inMotionCenter:Frame", "outValue:Frame", "")
        .to(Last, None(NoCounterpart::Device))
        .note("made for the youBot's arm of five joints, for which there is no driver"),
    ConversionRow::new("KUKA::youBot::SlaveError", M, "", "bit0:bool bit1:bool bit2:bool bit3:bool bit4:bool bit5:bool bit8:bool bit9:bool bit10:bool bit11:bool bit14:bool bit15:bool bit16:bool bit17:bool", "Robot:string= Port:int=0")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the youBot"),
    ConversionRow::new("schunkwsg::ClearSoftLimits", S, "", "outFinished:bool outStatusCode:int", "Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("schunkwsg::Grasping", S, "", "outFinished:bool outStatusCode:int", "Width:double=0 Speed:double=0 Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("schunkwsg::Homing", S, "", "outFinished:bool outStatusCode:int", "Direction:bool=true Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("schunkwsg::Monitor", M, "", "outForce:double outGraspingState:double outOpeningWidth:double outSpeed:double", "Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("schunkwsg::Prepositioning", S, "", "outFinished:bool outStatusCode:int", "Width:double=0 Speed:double=0 RelativeMotion:bool=true StopOnBlock:bool=false Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("schunkwsg::Releasing", S, "", "outFinished:bool outStatusCode:int", "OpenWidth:double=0 Speed:double=0 Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("schunkwsg::SetAcceleration", S, "", "outFinished:bool outStatusCode:int", "Acceleration:double=0 Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("schunkwsg::SetForceLimit", S, "", "outFinished:bool outStatusCode:int", "Force:double=0 Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("schunkwsg::SetSoftLimits", S, "", "outFinished:bool outStatusCode:int", "Inner:double=0 Outer:double=0 Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("schunkwsg::StopDevice", S, "", "outFinished:bool", "Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for the WSG gripper; a gripper on digital outputs is `DigitalOutput`"),
    ConversionRow::new("GNSS::SatelliteMonitor", M, "", "outLongitude:double outLatitude:double outAlitutde:double outHDOP:double outVDOP:double outNumSatellites:int", "Device:string=")
        .to(Last, None(NoCounterpart::Device))
        .note("no driver for satellite receivers"),
    ConversionRow::new("KUKA::youBot::OrientationPreservingProject", M, "inFlange*:Frame inMotionCenter:Frame", "outValue:Frame", "")
        .to(Last, None(NoCounterpart::Device))
        .note("made for the youBot's arm of five joints, for which there is no driver"),
    ConversionRow::new("PreviousNetResult", M, "", "outPreviousNetResult:bool", "previousNet:string=")
        .to(Last, None(NoCounterpart::Library))
        .note("no core of the predecessor has it"),
    ConversionRow::new("Takeover", M, "", "outTakeover:bool", "")
        .to(Last, None(NoCounterpart::Library))
        .note("no core of the predecessor has it"),
];
