from dataclasses import replace
import os

import numpy as np
import pytest

from wrist_ft_comp.calibration.calibrate import calibrate
from wrist_ft_comp.calibration.learning.day import look_at
from wrist_ft_comp.calibration.learning.lesson import Champion, take
from wrist_ft_comp.calibration.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.errors import WristFtCompError


def cp(a): return None if a is None else np.array(a, copy=True)
def m_nanrows(r, d):
    w=cp(d.wrench); w[r.random(len(w))<r.random()]=np.nan; return replace(d, wrench=w)
def m_nanforce(r,d):
    f=cp(d.specific_force); f[r.random(len(f))<r.random()]=np.nan; return replace(d,specific_force=f)
def m_gap(r,d):
    f,w=cp(d.specific_force),cp(d.wrench); a,b=sorted(r.integers(0,len(f),2)); (f if r.random()<.5 else w)[a:b]=np.nan; return replace(d,specific_force=f,wrench=w)
def m_axisnan(r,d):
    w=cp(d.wrench); w[:,r.random(6)<.4]=np.nan; return replace(d,wrench=w)
def m_axisconst(r,d):
    w=cp(d.wrench); w[:,r.random(6)<.3]=r.choice([0.,1.,-5e3]); return replace(d,wrench=w)
def m_tconst(r,d):
    t=cp(d.temperature_c); t[:]=25.; return replace(d,temperature_c=t)
def m_frozen(r,d):
    f=cp(d.specific_force); a,b=sorted(r.integers(0,len(f),2)); f[a:b]=f[a]; return replace(d,specific_force=f)
def m_scale(r,d):
    return replace(d,wrench=d.wrench*10.**r.uniform(-6,6))
def m_fscale(r,d):
    return replace(d,specific_force=d.specific_force*10.**r.uniform(-3,3))
def m_fzero(r,d):
    return replace(d,specific_force=0*d.specific_force)
def m_spike(r,d):
    w=cp(d.wrench); k=r.integers(0,len(w),r.integers(1,50)); w[k]=10.**r.uniform(1,9); return replace(d,wrench=w)
def m_spin(r,d):
    return replace(d,rotation_speed=None if r.random()<.4 else np.where(r.random(len(d))<r.random(),9.,0.) if r.random()<.6 else np.full(len(d),np.nan))
def m_step(r,d):
    w=cp(d.wrench)
    for _ in range(r.integers(1,6)): w[r.integers(0,len(w)):]+=r.normal(0,10,6)
    return replace(d,wrench=w)
def m_same(r,d):
    w=cp(d.wrench); w[:]=w[0]; return replace(d,wrench=w)
def m_perm(r,d):
    return replace(d,specific_force=d.specific_force[:,r.permutation(3)]*r.choice([-1,1],3))
M=[v for k,v in list(globals().items()) if k.startswith('m_')]
N=int(os.environ.get('FUZZ_N','60')); S=int(os.environ.get('FUZZ_S','0'))
@pytest.mark.parametrize('seed', range(S,S+N))
def test_fuzz(seed, make_working_day):
    r=np.random.default_rng(seed)
    days=[]
    names=[]
    for k in range(r.integers(1,4)):
        cells=int(r.choice([30,130,400,900,1800]))
        d=make_working_day(k+int(r.integers(0,50)),cells,part=bool(r.random()<.5),contacts=float(r.choice([0,.15,.6])),noise=float(r.choice([0,.05])))
        d=replace(d,name=f'day{k}.csv')
        if r.random()<.15: d=replace(d,specific_force=None,rotation_speed=None); names.append('noforce')
        else:
            for m in r.choice(len(M), r.integers(0,4)):
                names.append(M[m].__name__); d=M[m](r,d)
        days.append(d)
    s=CalibrationSettings('payload', identification=IdentificationSettings(method='pls'))
    out=[]
    np.seterr(all='raise', under='ignore') if os.environ.get('RAISE') else None
    try:
        c=calibrate(days,s); out.append('ok')
        for f in c.fits.values():
            if not np.isfinite(f.rms_after): out.append('nan')
    except WristFtCompError as e: out.append(str(e)[:110])
    try:
        look=lambda n: look_at(next(d for d in days if d.name==n))
        entries=[]
        for d in days:
            l=take(d.name,look,entries,Champion(),[x.name for x in days]); entries.append(l.entry); out.append((l.entry.incident or l.entry.verdict)[:60])
    except WristFtCompError as e: out.append('L '+str(e)[:80])
    print(seed,names,out)
