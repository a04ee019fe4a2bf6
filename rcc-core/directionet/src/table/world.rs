//! Vectors, rotations, frames, twists and wrenches, one row per type; `docs/from-the-predecessor.md` is generated from
//! it. Used by the loader's threads.

use super::Counterpart::{Net, None};
use super::NullReading::Last;
use super::PrimitiveClass::{A, M};
use super::{ConversionRow, NoCounterpart};

#[rustfmt::skip] // A row a type, readable as a table.
pub(super) const ROWS: &[ConversionRow] = &[
    ConversionRow::new("World::VectorAdd", A, "inFirst*:Vector inSecond*:Vector", "outValue:Vector", "")
        .to(Last, Net("{outValue=Add(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("World::VectorAverage", M, "inReset:bool inValue*:Vector", "outValue:Vector", "Duration:double=1")
        .to(Last, Net("{outValue=WindowMean(in=parent.inValue,window=parent.Duration).out}"))
        .note("`inReset` has no counterpart"),
    ConversionRow::new("World::VectorCross", A, "inFirst*:Vector inSecond*:Vector", "outValue:Vector", "")
        .to(Last, Net("{outValue=Cross(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("World::VectorDot", A, "inFirst*:Vector inSecond*:Vector", "outValue:double", "")
        .to(Last, Net("{outValue=Dot(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("World::VectorFromXYZ", A, "inX:double inY:double inZ:double", "outValue:Vector", "X:double=0 Y:double=0 Z:double=0")
        .to(Last, Net("{outValue=MakeVector(x=parent.inX,y=parent.inY,z=parent.inZ).out}")),
    ConversionRow::new("World::VectorRotate", A, "inRot*:Rotation inValue*:Vector", "outValue:Vector", "")
        .to(Last, Net("{outValue=TransformPoint(pose=MakePose(position=MakeVector(x='0',y='0',z='0').out,rotation=parent.inRot).out,point=parent.inValue).out}")),
    ConversionRow::new("World::VectorScale", A, "inFactor:double inValue*:Vector", "outValue:Vector", "Factor:double=1")
        .to(Last, Net("{outValue=Scale(in=parent.inValue,factor=parent.inFactor).out}")),
    ConversionRow::new("World::VectorToXYZ", A, "inValue:Vector", "outX:double outY:double outZ:double", "")
        .to(Last, Net("{s=SplitVector(in=parent.inValue),outX=s.x,outY=s.y,outZ=s.z}")),
    ConversionRow::new("World::RotationAverage", M, "inReset:bool inValue*:Rotation", "outValue:Rotation", "Duration:double=1")
        .to(Last, Net("{outValue=RotationFromAxes(x=WindowMean(in=Rotate(rotation=parent.inValue,in=MakeVector(x='1',y='0',z='0').out).out,window=parent.Duration).out,y=WindowMean(in=Rotate(rotation=parent.inValue,in=MakeVector(x='0',y='1',z='0').out).out,window=parent.Duration).out).out}"))
        .note("the means of the x and y axes, made perpendicular; `inReset` has no counterpart"),
    ConversionRow::new("World::RotationBezier", M, "inFrom*:Rotation inFromVel*:Vector inTo*:Rotation inToVel*:Vector inValue*:double", "outValue:Rotation", "")
        .to(Last, Net("{outValue=RotationBezier(from=parent.inFrom,to=parent.inTo,from_velocity=parent.inFromVel,to_velocity=parent.inToVel,s=parent.inValue).out}"))
        .note("always turns the short way, unlike the predecessor"),
    ConversionRow::new("World::RotationFromABC", A, "inA:double inB:double inC:double", "outValue:Rotation", "A:double=0 B:double=0 C:double=0")
        .to(Last, Net("{outValue=RotationFromRpy(roll=parent.inC,pitch=parent.inB,yaw=parent.inA).out}")),
    ConversionRow::new("World::RotationFromAxisAngle", A, "inAngle:double inAxis:Vector", "outValue:Rotation", "X:double=1 Y:double=0 Z:double=0 Angle:double=0")
        .to(Last, Net("{outValue=RotationFromVector(in=Scale(in=Else(link=parent.inAxis,otherwise=MakeVector(x=parent.X,y=parent.Y,z=parent.Z).out).x,factor=parent.inAngle).out).out}"))
        .note("an axis of length 0 gives no rotation"),
    ConversionRow::new("World::RotationFromQuaternion", A, "inW:double inX:double inY:double inZ:double", "outValue:Rotation", "X:double=1 Y:double=0 Z:double=0 W:double=0")
        .to(Last, Net("{outValue=RotationFromQuaternion(x=parent.inX,y=parent.inY,z=parent.inZ,w=parent.inW).out}")),
    ConversionRow::new("World::RotationInvert", A, "inValue*:Rotation", "outValue:Rotation", "")
        .to(Last, Net("{outValue=Invert(in=parent.inValue).out}")),
    ConversionRow::new("World::RotationToABC", A, "inValue:Rotation", "outA:double outB:double outC:double", "")
        .to(Last, Net("{r=RotationToRpy(in=parent.inValue),outA=r.yaw,outB=r.pitch,outC=r.roll}")),
    ConversionRow::new("World::RotationToAxisAngle", A, "inValue*:Rotation", "outAngle:double outAxis:Vector", "")
        .to(Last, Net("{r=RotationToAxisAngle(in=parent.inValue),outAngle=r.angle,outAxis=r.axis}")),
    ConversionRow::new("World::RotationToQuaternion", A, "inValue*:Rotation", "outW:double outX:double outY:double outZ:double", "")
        .to(Last, Net("{r=RotationToQuaternion(in=parent.inValue),outX=r.x,outY=r.y,outZ=r.z,outW=r.w}")),
    ConversionRow::new("World::RotationTransform", A, "inFirst:Rotation inSecond:Rotation", "outValue:Rotation", "")
        .to(Last, Net("{outValue=Compose(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("World::FrameAddTwist", A, "inFrame*:Frame inTwist*:Twist", "outValue:Frame", "")
        .to(Last, Net("{outValue=PoseAddTwist(pose=parent.inFrame,twist=parent.inTwist).out}")),
    ConversionRow::new("World::FrameFromPosRot", A, "inPos:Vector inRot:Rotation", "outValue:Frame", "X:double=0 Y:double=0 Z:double=0 A:double=0 B:double=0 C:double=0")
        .to(Last, Net("{outValue=MakePose(position=Else(link=parent.inPos,otherwise=MakeVector(x=parent.X,y=parent.Y,z=parent.Z).out).x,rotation=Else(link=parent.inRot,otherwise=RotationFromRpy(roll=parent.C,pitch=parent.B,yaw=parent.A).out).x).out}")),
    ConversionRow::new("World::FrameFromXYZ", A, "inRot:Rotation inX:double inY:double inZ:double", "outValue:Frame", "X:double=0 Y:double=0 Z:double=0 A:double=0 B:double=0 C:double=0")
        .to(Last, Net("{outValue=MakePose(position=MakeVector(x=parent.inX,y=parent.inY,z=parent.inZ).out,rotation=Else(link=parent.inRot,otherwise=RotationFromRpy(roll=parent.C,pitch=parent.B,yaw=parent.A).out).x).out}")),
    ConversionRow::new("World::FrameInvert", A, "inValue*:Frame", "outValue:Frame", "")
        .to(Last, Net("{outValue=Invert(in=parent.inValue).out}")),
    ConversionRow::new("World::FrameLerp", A, "inAmount*:double inFrom*:Frame inTo*:Frame", "outValue:Frame", "")
        .to(Last, Net("{outValue=Interpolate(from=parent.inFrom,to=parent.inTo,t=parent.inAmount).out}")),
    ConversionRow::new("World::FrameOTG", A, "inCurPos*:Frame inCurVel*:Twist inDestPos*:Frame inDestVel:Twist inMaxRotAcc:double inMaxRotVel:double inMaxTransAcc:double inMaxTransVel:double", "outPos:Frame outVel:Twist", "MaxTransVel:double=1 MaxTransAcc:double=1 MaxRotVel:double=1 MaxRotAcc:double=1")
        .to(Last, None(NoCounterpart::Elsewhere))
        .note("use `PoseGoal`, which plans to a new goal in any cycle, with jerk limits, from its own set-point"),
    ConversionRow::new("World::FrameToPosRot", A, "inValue:Frame", "outPosition:Vector outRotation:Rotation", "")
        .to(Last, Net("{s=SplitPose(in=parent.inValue),outPosition=s.position,outRotation=s.rotation}")),
    ConversionRow::new("World::FrameToXYZ", A, "inValue:Frame", "outRot:Rotation outX:double outY:double outZ:double", "")
        .to(Last, Net("{s=SplitPose(in=parent.inValue),v=SplitVector(in=s.position),outRot=s.rotation,outX=v.x,outY=v.y,outZ=v.z}")),
    ConversionRow::new("World::FrameTransform", A, "inFirst*:Frame inSecond*:Frame", "outValue:Frame", "")
        .to(Last, Net("{outValue=Compose(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("World::TwistAdd", A, "inFirst:Twist inSecond:Twist", "outValue:Twist", "")
        .to(Last, Net("{outValue=Add(a=parent.inFirst,b=parent.inSecond).out}")),
    ConversionRow::new("World::TwistChangeCenter", A, "inValue*:Twist inVector*:Vector", "outValue:Twist", "")
        .to(Last, Net("{outValue=TwistShift(in=parent.inValue,by=parent.inVector).out}")),
    ConversionRow::new("World::TwistFromFrames", A, "inFrame*:Frame inPrevFrame*:Frame", "outValue:Twist", "")
        .to(Last, Net("{outValue=TwistFromPoses(pose=parent.inFrame,previous=parent.inPrevFrame).out}")),
    ConversionRow::new("World::TwistFromVelocities", A, "inRotVel:Vector inTransVel:Vector", "outValue:Twist", "X:double=0 Y:double=0 Z:double=0 RX:double=0 RY:double=0 RZ:double=0")
        .to(Last, Net("{outValue=MakeTwist(linear=Else(link=parent.inTransVel,otherwise=MakeVector(x=parent.X,y=parent.Y,z=parent.Z).out).x,angular=Else(link=parent.inRotVel,otherwise=MakeVector(x=parent.RX,y=parent.RY,z=parent.RZ).out).x).out}")),
    ConversionRow::new("World::TwistFromXYZ", A, "inA:double inB:double inC:double inX:double inY:double inZ:double", "outValue:Twist", "X:double=0 Y:double=0 Z:double=0 A:double=0 B:double=0 C:double=0")
        .to(Last, Net("{outValue=MakeTwist(linear=MakeVector(x=parent.inX,y=parent.inY,z=parent.inZ).out,angular=MakeVector(x=parent.inC,y=parent.inB,z=parent.inA).out).out}")),
    ConversionRow::new("World::TwistRotate", A, "inRot*:Rotation inValue*:Twist", "outValue:Twist", "")
        .to(Last, Net("{outValue=TwistTransform(pose=MakePose(position=MakeVector(x='0',y='0',z='0').out,rotation=parent.inRot).out,in=parent.inValue).out}")),
    ConversionRow::new("World::TwistToVelocities", A, "inValue*:Twist", "outRotVel:Vector outTransVel:Vector", "")
        .to(Last, Net("{s=SplitTwist(in=parent.inValue),outTransVel=s.linear,outRotVel=s.angular}")),
    ConversionRow::new("World::TwistToXYZ", A, "inValue:Twist", "outA:double outB:double outC:double outX:double outY:double outZ:double", "")
        .to(Last, Net("{s=SplitTwist(in=parent.inValue),l=SplitVector(in=s.linear),a=SplitVector(in=s.angular),outX=l.x,outY=l.y,outZ=l.z,outA=a.z,outB=a.y,outC=a.x}")),
    ConversionRow::new("World::WrenchFromXYZ", A, "inA:double inB:double inC:double inX:double inY:double inZ:double", "outValue:Wrench", "X:double=0 Y:double=0 Z:double=0 A:double=0 B:double=0 C:double=0")
        .to(Last, Net("{outValue=MakeWrench(force=MakeVector(x=parent.inX,y=parent.inY,z=parent.inZ).out,torque=MakeVector(x=parent.inC,y=parent.inB,z=parent.inA).out).out}")),
    ConversionRow::new("World::WrenchToXYZ", A, "inValue:Wrench", "outA:double outB:double outC:double outX:double outY:double outZ:double", "")
        .to(Last, Net("{s=SplitWrench(in=parent.inValue),f=SplitVector(in=s.force),t=SplitVector(in=s.torque),outX=f.x,outY=f.y,outZ=f.z,outA=t.z,outB=t.y,outC=t.x}")),
];
